"""`r2bspec validate` and `r2bspec docs --schema`, as a user calls them."""

from __future__ import annotations

import functools
import io
import json
import shutil
import sys
from pathlib import Path

import pytest

from command_line import Call
from r2bspec.language.json_schema import published_schema

GOLDEN = Path(__file__).parents[2] / "golden" / "language"


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    shutil.copy(GOLDEN / "version.yaml", "bad.r2b.yaml")
    good = (GOLDEN / "ok_minimal.yaml").read_text()
    Path("good.r2b.yaml").write_text(good)
    Path("deep/er").mkdir(parents=True)
    Path("deep/er/other.r2b.yaml").write_text(good)
    Path("deep/.hidden").mkdir()
    Path("deep/.hidden/no.r2b.yaml").write_text("broken: [")
    Path("deep/notes.yaml").write_text("broken: [")
    return tmp_path


@pytest.fixture
def run(call: Call) -> Call:
    return functools.partial(call, "validate", "--offline")


def test_findings_go_to_standard_output(folder: Path, run: Call) -> None:
    _, out, err = run("bad.r2b.yaml", status=1)
    assert out.startswith(
        "bad.r2b.yaml:1:10: error[R2B115 unsupported-language-version]: "
        "unsupported version 3 of the language"
    )
    assert "1 | r2bspec: 3\n  |          ^\n" in out
    last = out.splitlines()[-1]
    assert last.startswith("1 file, 1 error, 0 warnings")
    assert err == ""


@pytest.mark.parametrize(
    ("paths", "count"),
    [
        (["."], "3 files"),
        (["deep"], "1 file"),
        (["*.r2b.yaml"], "2 files"),
        (["**/*.r2b.yaml"], "3 files"),
        (["good.r2b.yaml", "good.r2b.yaml", "*d.r2b.yaml"], "2 files"),
        (["deep/notes.yaml"], "1 file"),
    ],
)
def test_files_folders_and_patterns(folder: Path, run: Call, paths: list[str], count: str) -> None:
    assert run(*paths).out.splitlines()[-1].startswith(f"{count}, ")


@pytest.mark.parametrize(
    "arguments",
    [
        ["nowhere.r2b.yaml"],
        ["*.nothing"],
        ["deep/.hidden/.."],
        [],
        ["good.r2b.yaml", "--var", "x"],
        ["good.r2b.yaml", "--format", "xml"],
    ],
)
def test_wrong_usage(folder: Path, run: Call, arguments: list[str]) -> None:
    Path("deep/er/other.r2b.yaml").unlink()
    _, out, err = run(*arguments, status=2)
    assert out == ""
    assert "Error" in err


def test_standard_input(folder: Path, run: Call, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "stdin", io.TextIOWrapper(io.BytesIO(b"r2bspec: 2\n")))
    assert run("-", status=1).out.startswith("<stdin>:1:1: error[R2B102 missing-key]")


def test_options_replace_values(folder: Path, run: Call) -> None:
    run("bad.r2b.yaml", "--set", "r2bspec=1", status=0)
    ended = run("good.r2b.yaml", "--set", "benchmark.rates=[30]", status=1)
    assert "--set benchmark.rates:1:18: error[R2B109 missing-unit]" in ended.out


def test_resolved(folder: Path, run: Call) -> None:
    ended = run("good.r2b.yaml", "--resolved", "--set", "name=other", status=0)
    assert ended.out.startswith("r2bspec: 1\nname: other\n")
    ended = run("bad.r2b.yaml", "--resolved", status=1)
    assert "error[R2B115 unsupported-language-version]" in ended.out
    out = run("good.r2b.yaml", "deep", "--resolved", status=0).out
    assert out.startswith("# good.r2b.yaml\n")
    assert "\n---\n# deep/er/other.r2b.yaml\n" in out


def test_schema(call: Call) -> None:
    assert json.loads(call("docs", "--schema", "spec", status=0).out) == published_schema()
    call("docs", "--schema", "nonsense", status=2)


# ---- files that build on files, and cases ------------------------------------------------------

CASES = """extends: base.yaml
name: some
variables: {threads: 1}
matrix: {axes: {threads: [1, 2]}}
labels: {queue: $(var threads)}
"""


@pytest.fixture
def cases(folder: Path) -> Path:
    (folder / "base.yaml").write_text((GOLDEN / "ok_minimal.yaml").read_text())
    (folder / "cases.r2b.yaml").write_text(CASES)
    return folder


def test_every_case_is_checked(cases: Path, run: Call) -> None:
    run("cases.r2b.yaml", status=0)
    run("cases.r2b.yaml", "--case", "threads=2", status=0)
    run("cases.r2b.yaml", "--set", "matrix.axes.threads=[1, two words, x]", status=0)
    out = run("cases.r2b.yaml", "--case", "threads=3", status=1).out
    assert "cases.r2b.yaml:4:1: error[R2B140 case-not-selected]: unknown case 'threads=3'" in out


def test_every_case_is_resolved(cases: Path, run: Call) -> None:
    documents = run("cases.r2b.yaml", "--resolved", status=0).out.split("---\n")
    heads = [document.splitlines()[0] for document in documents]
    assert heads == ["# cases.r2b.yaml [threads=1]", "# cases.r2b.yaml [threads=2]"]
    assert "queue: 2" in documents[1]
    assert "extends" not in documents[1]
    assert "matrix" not in documents[1]


def test_strict_fails_on_warnings_and_quiet_prints_findings_only(folder: Path, run: Call) -> None:
    text = Path("good.r2b.yaml").read_text()
    Path("warned.r2b.yaml").write_text(f"{text}variables: {{unused: 1}}\n")
    assert "0 errors, 1 warning" in run("warned.r2b.yaml", status=0).out
    said = run("warned.r2b.yaml", "--strict", "--quiet", status=1).out
    assert "warning[" in said
    assert "1 warning" not in said
    assert run("good.r2b.yaml", "-q", "--strict", status=0).out == ""
