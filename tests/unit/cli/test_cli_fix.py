"""`r2bspec validate --fix`, `--diff` and the machine-readable formats, as a user calls them."""

from __future__ import annotations

import json
import os
import subprocess
import xml.etree.ElementTree as ET
from pathlib import Path

import pytest

from example_spec import example
from r2bspec.cli.main import main

BROKEN = (
    example(benchmark="{rates: [30, 20hz]} # in Hz").replace("\n", "\r\n")
    + "# the end, without a line end"
)
REPAIRED = BROKEN.replace("[30, 20hz]", "[30 Hz, 20 Hz]")


@pytest.fixture
def spec(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    file = Path("a.r2b.yaml")
    file.write_bytes(BROKEN.encode())
    file.chmod(0o640)
    return file


def validate(*arguments: str) -> int:
    return main(["validate", "--offline", *arguments])


def test_fix_keeps_all_but_the_mistake(spec: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert validate("--fix", str(spec)) == 0
    assert spec.read_bytes().decode() == REPAIRED
    assert spec.stat().st_mode & 0o777 == 0o640
    out, err = capsys.readouterr()
    assert out.startswith("1 file, no problems")
    assert err == "2 problems repaired in 1 of 1 files\n"
    assert os.listdir() == ["a.r2b.yaml"]


def test_fix_again_changes_nothing(spec: Path, capsys: pytest.CaptureFixture[str]) -> None:
    validate("--fix", str(spec))
    before = spec.stat()
    capsys.readouterr()
    assert validate("--fix", str(spec)) == 0
    after = spec.stat()
    assert (after.st_mtime_ns, after.st_ino) == (before.st_mtime_ns, before.st_ino)
    assert capsys.readouterr().err == "0 problems repaired in 0 of 1 files\n"


def test_fix_reports_what_is_left(spec: Path, capsys: pytest.CaptureFixture[str]) -> None:
    spec.write_text(example(benchmark="{rates: [30], iterations: -1}"))
    assert validate("--fix", str(spec)) == 1
    assert "error[R2B107 number-out-of-range]" in capsys.readouterr().out
    assert "rates: [30 Hz], iterations: -1" in spec.read_text()


def test_fix_follows_a_link_and_keeps_it(spec: Path) -> None:
    link = Path("b.r2b.yaml")
    link.symlink_to(spec)
    assert validate("--fix", str(link)) == 0
    assert link.is_symlink()
    assert spec.read_bytes().decode() == REPAIRED


@pytest.mark.parametrize("name", ["elsewhere/c.r2b.yaml", "step.r2b.yaml"])
def test_fix_does_not_write_through_a_link_to_another_folder(
    spec: Path, capsys: pytest.CaptureFixture[str], name: str
) -> None:
    target = Path("elsewhere/c.r2b.yaml")
    target.parent.mkdir()
    target.write_bytes(BROKEN.encode())
    # The second link is in the folder, and leads on.
    Path("step.r2b.yaml").symlink_to(target)
    link = Path("b.r2b.yaml")
    link.symlink_to(name)
    assert validate("--fix", str(link)) == 2
    assert target.read_bytes() == BROKEN.encode()
    assert link.is_symlink()
    error = capsys.readouterr().err
    assert "is a link to" in error
    assert "in another folder" in error


def test_fix_keeps_a_byte_order_mark(spec: Path) -> None:
    spec.write_bytes(b"\xef\xbb\xbf" + BROKEN.encode())
    assert validate("--fix", str(spec)) == 0
    assert spec.read_bytes() == b"\xef\xbb\xbf" + REPAIRED.encode()


def test_fix_leaves_what_cannot_be_read(spec: Path) -> None:
    spec.write_bytes(b"\xff\xfe\x00")
    assert validate("--fix", str(spec)) == 1
    assert spec.read_bytes() == b"\xff\xfe\x00"


def test_diff_writes_nothing_and_can_be_applied(
    spec: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert validate("--diff", str(spec)) == 1
    assert spec.read_bytes().decode() == BROKEN
    out, err = capsys.readouterr()
    assert out.startswith("--- a/a.r2b.yaml\n+++ b/a.r2b.yaml\n")
    assert err == "2 problems can be repaired by --fix in 1 of 1 files\n"
    subprocess.run(["git", "apply", "-"], input=out.encode(), check=True)  # noqa: S607
    assert spec.read_bytes().decode() == REPAIRED
    assert validate("--diff", str(spec)) == 0
    assert capsys.readouterr().out == ""


def test_fix_needs_files(spec: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert validate("--fix", "-") == 2
    assert validate("--fix", "--diff", str(spec)) == 2
    assert spec.read_bytes().decode() == BROKEN


def test_a_file_that_cannot_be_written(spec: Path, capsys: pytest.CaptureFixture[str]) -> None:
    if os.geteuid() == 0:
        pytest.skip("root may write everywhere")
    Path().chmod(0o500)
    try:
        assert validate("--fix", str(spec)) == 2
    finally:
        Path().chmod(0o700)
    assert "error[R2B601 wrong-usage]: a.r2b.yaml cannot be written" in capsys.readouterr().err


def test_sarif_and_junit_are_whole_documents(
    spec: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert validate("--format", "sarif", str(spec)) == 1
    (run,) = json.loads(capsys.readouterr().out)["runs"]
    assert [one["ruleId"] for one in run["results"]] == ["R2B109", "R2B110"]
    assert validate("--format", "junit", str(spec)) == 1
    (suite,) = ET.fromstring(capsys.readouterr().out)  # noqa: S314
    assert suite.attrib["failures"] == "1"


def test_the_problem_matcher_reads_the_first_line_of_each_finding(
    spec: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    import re

    root = Path(__file__).parents[3]
    matcher = json.loads((root / ".github" / "r2bspec-problem-matcher.json").read_text())
    (pattern,) = matcher["problemMatcher"][0]["pattern"]
    validate(str(spec))
    lines = capsys.readouterr().out.splitlines()
    matches = [match for line in lines if (match := re.search(pattern["regexp"], line))]
    read = [{key: match[pattern[key]] for key in ("file", "line", "code")} for match in matches]
    line = str(len(BROKEN.splitlines()) - 1)
    assert read == [
        {"file": "a.r2b.yaml", "line": line, "code": "R2B109"},
        {"file": "a.r2b.yaml", "line": line, "code": "R2B110"},
    ]
