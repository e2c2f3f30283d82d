"""``r2bspec gate``: what is refused before anything is played, estimates, and the summary."""

from __future__ import annotations

import contextlib
import functools
import html
import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest

from command_line import Call
from example_spec import example
from git_repositories import commit, git
from nightly import sampled
from pair_simulation import Comparison
from r2bspec import api
from r2bspec.compare.merge_gate import ComparedSpec, GateSides, MergeGate
from r2bspec.compare.report_input import read_folder
from r2bspec.execute.identity.identify_graph import graph_identity
from r2bspec.judge.result import Result
from r2bspec.report.notes import notes
from r2bspec.report.suite import SuiteSummary, render
from r2bspec.safe_io.git import commit_of

NOISE = np.exp([0.004, -0.006, 0.005, -0.004])

JUNIT = ("--report", "junit=junit.xml")
USED = {"busy_s": 1.94}


def spec(name: str) -> str:
    return example(name, slos="{fast: {at: 30 Hz, require: [latency.p90 < 50 ms]}}")


@pytest.fixture
def top(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A repository with two folders of specs; HEAD is on a branch that starts at ``main``."""
    folder = tmp_path / "repository"
    commit(
        folder,
        {
            "alone/blur.r2b.yaml": spec("blur"),
            "bench/a.r2b.yaml": spec("a"),
            "bench/b.r2b.yaml": spec("b"),
        },
    )
    git(folder, "checkout", "--quiet", "-b", "change")
    monkeypatch.chdir(folder)
    temporary = tmp_path / "temporary"
    temporary.mkdir()
    monkeypatch.setattr("tempfile.tempdir", str(temporary))
    return folder


@pytest.fixture
def played(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[list[str]]:
    """The names of the benchmarks that were played, by a comparison that is simulated."""
    names: list[str] = []

    def run_gated(
        gate: MergeGate,
        compared: ComparedSpec,
        sides: GateSides,
        folder: Path,
        *_: Any,
        **__: Any,
    ) -> Result:
        head = compared.head
        names.append(head.plan.name)
        level = (0.020 * (NOISE**10 if head.plan.name == "open" else NOISE)).tolist()
        load = {1: USED} if head.plan.name == "open" else {}
        comparison = Comparison(level, level[::-1], load=load)
        result = read_folder(comparison.write(folder).folder).result
        code = graph_identity(head.plan, head.base_dir, top=gate.tree.head_top)
        result = msgspec.structs.replace(result, name=head.plan.name, identity=code)
        if sides.base is None:
            return msgspec.structs.replace(result, pairs=None, gate=sides.sentences)
        base = msgspec.structs.replace(code, revision=gate.tree.revision)
        return msgspec.structs.replace(result, base_identity=base)

    monkeypatch.setattr(api, "run_gated", run_gated)
    yield names
    assert list((tmp_path / "temporary").iterdir()) == []


@pytest.fixture
def gate(call: Call) -> Call:
    return functools.partial(call, "gate", "--base", "main", "--no-lock")


def suite(folder: Path) -> SuiteSummary:
    return msgspec.json.decode((folder / "suite.json").read_bytes(), type=SuiteSummary)


GONE = "alone/blur.r2b.yaml (gone)"


@pytest.mark.parametrize("path", ["alone", "alone/blur.r2b.yaml"])
def test_the_only_spec_of_a_folder_is_gone(
    top: Path, played: list[str], gate: Call, path: str
) -> None:
    git(top, "rm", "--quiet", "alone/blur.r2b.yaml")
    commit(top)
    formats = {name: top / f"reports/all.{name}" for name in ("junit", "html", "json", "csv")}
    options = [f"--report={name}={file}" for name, file in formats.items()]
    said = gate(path, *options[:-1], status=2).err
    assert "R2B692" in formats["html"].read_text()
    assert json.loads(formats["json"].read_text())["code"] == "R2B692"
    assert "spec alone/blur.r2b.yaml" in formats["junit"].read_text()
    assert "error[R2B692 weaker-gate]: the gate differs from that of main@" in said
    assert f": spec {GONE}" in said
    assert "let the pipeline allow it: --allow 'spec alone/blur.r2b.yaml'" in said
    assert not (top / "runs").exists()
    out = gate(path, *options, "--allow=spec alone/blur.r2b.yaml", status=0).out
    assert out == f"0 runs: nothing to run\n\nnotes\n  Allowed: spec {GONE}.\n"
    assert json.loads(formats["json"].read_text())["gate"]
    assert played == []


def test_a_spec_that_is_gone_is_refused_before_anything_is_played(
    top: Path, played: list[str], gate: Call
) -> None:
    git(top, "rm", "--quiet", "bench/a.r2b.yaml")
    commit(top)
    said = gate("bench", "--format", "json", status=2)
    assert ": spec bench/a.r2b.yaml (gone)" in said.err
    assert json.loads(said.out)["code"] == "R2B692"
    assert played == []
    out = gate("bench", "--allow", "spec bench/a.r2b.yaml", "-o", "out", status=0).out
    assert played == ["b"]
    assert [run.name for run in suite(top / "out").runs] == ["b"]
    assert "Allowed: spec bench/a.r2b.yaml (gone)" in out


def test_the_summary_of_a_gate_has_ratios_and_names_new_specs_and_revisions_once(
    top: Path, played: list[str], gate: Call
) -> None:
    base = commit_of(top, "main") or ""
    commit(top, {"bench/c.r2b.yaml": spec("c"), "bench/d.r2b.yaml": spec("d")})
    revisions = f"Head {(commit_of(top, 'HEAD') or '')[:7]}+dirty, base main@{base[:7]}"
    with (top / "bench/a.r2b.yaml").open("a") as file:
        file.write("# not committed\n")
    text = gate("bench", "-o", "out", status=0).out
    lines = text.splitlines()
    header = next(line for line in lines if line.startswith("verdict"))
    assert header.split()[:6] == ["verdict", "spec", "requirement", "base", "head", "ratio"]
    ratio = next(line for line in lines if re.search(r"PASS +a ", line))
    assert re.search(r"20 ms +20 ms +(99\.\d|100) % \[", ratio)
    summary = suite(top / "out")
    assert [len(run.gate) for run in summary.runs][:2] == [0, 0]
    for shown in (text, decoded(summary, "markdown"), decoded(summary, "html")):
        assert "c, d: New spec: main" in shown
        assert "has nothing to compare it with." in " ".join(shown.split())
        assert shown.count(revisions) == 1
    changed = msgspec.structs.replace(summary.runs[0], revision="1234567")
    mixed = msgspec.structs.replace(summary, runs=(changed, *summary.runs[1:]))
    text = render("text", mixed, {}).decode()
    assert text.count(revisions[1:]) == 1
    assert f"  a: head 1234567, base main@{base[:7]}\n" in text


def test_an_open_spec_of_a_folder_says_what_the_host_did_and_how_many_pairs_are_needed(
    top: Path, played: list[str], gate: Call
) -> None:
    commit(top, {"bench/open.r2b.yaml": spec("open")})
    git(top, "branch", "--force", "main", "HEAD")
    said = gate("bench", "-o", "out", status=3)
    [note, *_] = notes(read_folder(top / "out/open").result)
    assert note.startswith("Host interference")
    assert "other processes used" in note
    assert f"\n  {note}\n" in said.err
    summary = suite(top / "out")
    for shown in (said.out, *(decoded(summary, name) for name in ("markdown", "html"))):
        assert re.search(r"about \d+ (more )?pairs.* would decide it", " ".join(shown.split()))


def decoded(summary: SuiteSummary, name: str) -> str:
    """A summary in a format, without what the format escapes."""
    text = html.unescape(render(name, summary, {}).decode())
    return text.replace("\\", "")


@pytest.fixture
def lock(monkeypatch: pytest.MonkeyPatch, played: list[str]) -> list[list[str]]:
    """What had been played each time that the lock of the host was taken."""
    taken: list[list[str]] = []

    @contextlib.contextmanager
    def host_to_itself(*_: Any, **__: Any) -> Iterator[None]:
        taken.append(list(played))
        yield

    monkeypatch.setattr("r2bspec.execute.host_queue.host_to_itself", host_to_itself)
    return taken


@pytest.fixture
def locked_gate(call: Call, lock: list[list[str]]) -> Call:
    return functools.partial(call, "gate", "--base", "main", "--quiet")


def weaker(name: str) -> str:
    return spec(name).replace("50 ms", "70 ms")


def test_every_spec_of_a_folder_is_compared_before_the_first_is_played(
    top: Path, played: list[str], lock: list[list[str]], locked_gate: Call
) -> None:
    commit(top, {"bench/c.r2b.yaml": "r2bspec: 1\n", "bench/d.r2b.yaml": spec("d")})
    git(top, "branch", "--force", "main", "HEAD")
    changed = {"b": weaker("b"), "c": spec("c"), "d": example("d")}
    commit(top, {f"bench/{name}.r2b.yaml": text for name, text in changed.items()})
    options = ["-o", "out", *JUNIT]
    said = locked_gate("bench", *options, status=2)
    # What is weaker, a base that cannot be used, and missing objectives: each is told.
    for code in ("R2B692", "R2B698", "R2B693"):
        assert code in said.err
        assert code in said.out
        assert code in Path("junit.xml").read_text()
    assert (played, lock) == ([], [])
    runs = suite(top / "out").runs
    outcomes = [(run.name, run.outcome) for run in runs]
    assert outcomes == [("a", "skipped"), ("b", "error"), ("c", "error"), ("d", "error")]
    assert "the gate refuses another spec" in runs[0].reason


def test_the_lock_of_the_host_is_taken_right_before_the_first_start(
    top: Path, played: list[str], lock: list[list[str]], locked_gate: Call
) -> None:
    locked_gate("bench", status=0)
    assert (lock, played) == ([[]], ["a", "b"])
    locked_gate("alone/blur.r2b.yaml", status=0)
    assert lock == [[], ["a", "b"]]
    git(top, "rm", "--quiet", "alone/blur.r2b.yaml")
    locked_gate("alone", "--allow", "spec alone/blur.r2b.yaml", status=0)
    assert lock == [[], ["a", "b"]], "nothing is played"


@pytest.mark.parametrize("path", sampled(["alone", "alone/blur.r2b.yaml"], 2))
@pytest.mark.parametrize(
    ("changes", "options", "code"),
    [
        ({}, ["--base", "mian"], "R2B694"),
        ({}, ["--allow", "objective fats"], "objective fats"),
        ({"alone/blur.r2b.yaml": None}, [], "R2B692"),
        ({"alone/blur.r2b.yaml": weaker("blur")}, [], "R2B692"),
    ],
)
def test_what_needs_no_playing_is_told_without_the_lock(
    top: Path,
    played: list[str],
    lock: list[list[str]],
    call: Call,
    path: str,
    changes: dict[str, str | None],
    options: list[str],
    code: str,
) -> None:
    for name, text in changes.items():
        if text is None:
            git(top, "rm", "--quiet", name)
        else:
            (top / name).write_text(text)
    against = [] if "--base" in options else ["--base", "main"]
    assert code in call("gate", path, *options, *against, *JUNIT, status=2).err
    assert code in Path("junit.xml").read_text()
    assert (played, lock) == ([], [])


def test_an_objective_that_only_the_base_has_can_be_allowed(
    top: Path, played: list[str], lock: list[list[str]], locked_gate: Call
) -> None:
    renamed = weaker("blur").replace("fast:", "swift:")
    (top / "alone/blur.r2b.yaml").write_text(renamed)
    locked_gate("alone", status=2)
    assert played == []
    locked_gate("alone", "--allow", "objective fast", status=0)
    assert played == ["blur"]


def test_a_matrix_is_gated_case_by_case(top: Path, played: list[str], gate: Call) -> None:
    axes = "name: blur\nvariables: {n: 1}\nmatrix: {axes: {n: [1, 2]}}"
    text = spec("blur").replace("name: blur", axes)
    commit(top, {"alone/blur.r2b.yaml": text})
    gate("alone/blur.r2b.yaml", status=0)
    assert played == ["blur[n=1]", "blur[n=2]"]
    (top / "alone/blur.r2b.yaml").write_text(text.replace("50 ms", "70 ms"))
    assert gate("alone/blur.r2b.yaml", status=2).err.count("weaker-gate]: not the gate of") == 2


def test_what_is_not_gated_is_said(top: Path, played: list[str], gate: Call) -> None:
    (top / "bench/c.r2b.yaml").symlink_to("a.r2b.yaml")
    assert "Not gated: bench/c.r2b.yaml is a link" in gate("bench", status=0).out
    assert played == ["a", "b"]
