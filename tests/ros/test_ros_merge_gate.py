"""Pull requests through the merge gate, on real ROS 2: what each of them comes to.

The table of docs/gate.md has the expected outcomes; `test_the_page_has_this_table` compares it with
`OUTCOMES`. How often a comparison of starts errs is simulated (tests/simulation): these tests
assert only what no load of the machine can change.

Every kind goes through the step of the GitHub action, whose summary the assertions read. The shell
script differs in what comes before and after a run; what is played is the same. So one kind goes
through both; R2BSPEC_NIGHTLY=1 sends all of them.
"""

from __future__ import annotations

import json
import re
import shutil
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

pytest.importorskip("rclpy")

from busy_programs import busy_programs
from git_repositories import git
from nightly import only_nightly, sampled, size
from pull_requests import PACKAGE, PARAMETERS, SPEC, Recipe, Workspace, spec, without_sections
from ros_runs import write_bag

OUTCOMES = {
    "neutral": "PASS",
    "node 15 % slower": "FAIL",
    "node with 15 % more work, beside busy programs": "FAIL",
    "node 15 % faster": "PASS",
    "node crashes": "error, exit status 2 or 4",
    "parameter file changed": "judged; the report names the file",
    "dependency changed": "judged; the report names its file, or both versions",
    "objective weakened": "error R2B692, exit status 2",
    "objective deleted": "error R2B692, exit status 2",
    "all objectives deleted": "error R2B693, exit status 2",
    "recording or preprocessor changed": (
        "error R2B692, exit status 2; with `--allow input` both sides get it"
    ),
    "spec deleted, renamed, or a link": "error R2B692, exit status 2",
    "new spec without a base": "the head alone is judged",
    "base that fails itself": "error R2B698, exit status 2; with `--allow base` the head alone",
    "base whose spec is broken": "error R2B698, exit status 2; with `--allow base` the head alone",
    "base that does not build": "error R2B695, exit status 2; with `--allow base` the head alone",
    "dirty work tree": "judged as it is; the report says `+dirty`",
    "same spec and code on both sides": "judged; the report says both",
    "base that is ambiguous, or not in a shallow clone": (
        "error R2B694, exit status 2, with what to do"
    ),
    "a side that loads files of the other": "error R2B696, exit status 2",
}
"""What a pull request is, and what the gate makes of it."""

ONE_PAIR = ("--pairs", "1")
"""Enough where only what is compared matters: a ratio of one pair is always open."""

BOTH = pytest.mark.parametrize("recipe", ["action", "shell"])
SAMPLED = pytest.mark.parametrize("recipe", ["action", pytest.param("shell", marks=only_nightly())])

BASE = r"(main@)?[0-9a-f]{7}"
"""How a report names the base: the action compares with a commit, the script with a branch."""


@pytest.fixture
def workspace(
    tmp_path: Path, recipe: Recipe, monkeypatch: pytest.MonkeyPatch
) -> Iterator[Workspace]:
    """A repository; every gate removes the work tree of its base, whatever happened."""
    temporary = tmp_path / "temporary"
    temporary.mkdir()
    monkeypatch.setenv("TMPDIR", str(temporary))
    made = Workspace.create(tmp_path, recipe)
    yield made
    assert list(temporary.glob("r2bspec-base-*")) == []
    assert git(made.top, "worktree", "list").count("\n") == 0


@only_nightly()
@SAMPLED
def test_a_neutral_change_does_not_fail(workspace: Workspace) -> None:
    node = (workspace.top / PACKAGE / "node.py").read_text()
    workspace.change({f"{PACKAGE}/node.py": f"{node}# v2\n"})
    gated = workspace.gate("--pairs", "5")
    gated.assert_status(0, 3)
    assert "node.py changed" in gated.summary
    record = json.loads((gated.folder / "pairs.json").read_text())
    assert re.match(BASE, record["against"])


@SAMPLED
def test_a_slower_node_does_not_pass(workspace: Workspace) -> None:
    workspace.set_cost(23.0)
    gated = workspace.gate("--pairs", str(size(2, 5)))
    gated.assert_status(1, 3)
    assert re.search(rf"{BASE}.*cost\.py changed", gated.summary)
    result = json.loads((gated.folder / "result.json").read_text())
    requirements = result["verdict"]["requirements"]
    (ratio,) = [
        requirement["estimate"]
        for requirement in requirements
        if requirement["objective"] == "fast"
    ]
    assert ratio > 1.05


@only_nightly()
@pytest.mark.parametrize("recipe", ["shell"])
def test_a_node_with_more_work_does_not_pass_beside_busy_programs(workspace: Workspace) -> None:
    work = {"cost": {"at": "20 Hz", "require": ["work.blur.p50 <= 105 % of baseline"]}}
    node = (workspace.top / PACKAGE / "node.py").read_text()
    working = node.replace("smooth(self.cost_s)", "sum(range(400_000))")
    workspace.change({f"{PACKAGE}/node.py": working, SPEC: spec(slos=work)}, on_main=True)
    workspace.change({f"{PACKAGE}/node.py": working.replace("400_000", "600_000")})
    with busy_programs(2):
        gated = workspace.gate("--pairs", "12")
    gated.assert_status(1, 3)
    result = json.loads((gated.folder / "result.json").read_text())
    (requirement,) = result["verdict"]["requirements"]
    assert requirement["method"] == "trimmed t by turns"
    assert requirement["estimate"] > 1.05


@only_nightly()
@SAMPLED
def test_a_faster_node_does_not_fail(workspace: Workspace) -> None:
    workspace.set_cost(17.0)
    workspace.gate("--pairs", "5").assert_status(0, 3)


@SAMPLED
@only_nightly()
def test_a_node_that_crashes_is_the_heads_failure(workspace: Workspace) -> None:
    workspace.change({f"{PACKAGE}/cost.py": "raise RuntimeError('no such kernel')\n"})
    gated = workspace.gate(*ONE_PAIR)
    gated.assert_status(2, 4)
    assert "no such kernel" in gated.summary
    assert "R2B698" not in gated.said


RENAMED = "bench/renamed.r2b.yaml"
WEAKER = spec().replace("107 % of", "150 % of")


@SAMPLED
def test_what_changed_is_judged_and_named(workspace: Workspace) -> None:
    """A recording, a parameter file, the name of the spec, an objective, what is not committed."""
    git(workspace.top, "mv", SPEC, RENAMED)
    recording = workspace.top / "bench/drive"
    shutil.rmtree(recording)
    write_bag(recording, {"/camera": [50 * at for at in range(20)]}, (8, 8))
    parameters = "/**:\n  ros__parameters:\n    cost_ms: 21.0\n"
    workspace.change({PARAMETERS: parameters, RENAMED: WEAKER})
    with (workspace.top / PACKAGE / "cost.py").open("a") as file:
        file.write("# not committed\n")
    gated = workspace.gate(*ONE_PAIR, spec=RENAMED, allow=f"input\nobjective fast\nspec {SPEC}")
    gated.assert_status(0, 1, 3)
    assert "Both sides get that of the head" in gated.summary
    played = [
        json.loads((gated.folder / f"{side}/001/record.json").read_text())["dataset"]["sha256"]
        for side in ("base", "head")
    ]
    assert played[0] == played[1]
    for words in ("blur.yaml changed", "+dirty", "cost.py changed"):
        assert words in gated.summary
    assert re.search(rf"Renamed: the spec is {SPEC} in {BASE}", gated.summary)
    assert "allowed: objective fast" in gated.summary.lower()
    # Each side has loaded its own files.
    loaded = json.loads((gated.folder / "base/001/loaded_files.json").read_text())["blur"]
    assert any("/r2bspec-base-" in path and path.endswith("blur/cost.py") for path in loaded)
    loaded = json.loads((gated.folder / "head/001/loaded_files.json").read_text())["blur"]
    assert str(workspace.head / PACKAGE / "cost.py") in loaded


@BOTH
def test_an_objective_that_is_weakened_is_an_error_at_its_line(workspace: Workspace) -> None:
    workspace.change({SPEC: WEAKER})
    gated = workspace.gate()
    gated.assert_status(2)
    for text in (gated.said, gated.summary):
        assert re.search(rf"{SPEC}:\d+:\d+: error\[R2B692 weaker-gate\].*150 %.*107 %", text)
        assert "--allow 'objective fast'" in text


BROKEN = spec() + "nonsense: 1\n"
UNBUILT = {
    "duration": "1 s",
    "rates": ["20 Hz"],
    "gate": {"base": {"build": [["sh", "-c", "echo 'no compiler' >&2; exit 3"]]}},
}
ARRIVES = {"arrives": {"at": "20 Hz", "require": ["received > 0"]}}
REFUSED = {
    "objective deleted": (None, {SPEC: spec(slos=ARRIVES)}, ("R2B692", "objective fast")),
    "all objectives deleted": (None, {SPEC: without_sections("slos")}, ("R2B693 missing-obj",)),
    "base whose spec is broken": (
        {SPEC: BROKEN},
        {SPEC: spec()},
        ("R2B698", f"cannot be compared with: {SPEC}"),
    ),
    "base that does not build": (
        {SPEC: spec(benchmark=UNBUILT)},
        {f"{PACKAGE}/new.py": ""},
        ("R2B695", "no compiler", "--allow base"),
    ),
}
"""What is on the base, what is changed, and what is said of that."""


@SAMPLED
@pytest.mark.parametrize("kind", sampled(REFUSED, len(REFUSED), len(REFUSED) - 1))
def test_what_is_refused_before_anything_is_played(workspace: Workspace, kind: str) -> None:
    base, changed, words = REFUSED[kind]
    if base is not None:
        workspace.change(base, on_main=True)
    workspace.change(changed)
    gated = workspace.gate()
    gated.assert_status(2)
    assert [word for word in words if word not in gated.summary + gated.said] == []
    assert words[0] in gated.summary
    assert "starting the graph" not in gated.said


@SAMPLED
@only_nightly()
def test_a_spec_that_is_deleted(workspace: Workspace) -> None:
    git(workspace.top, "mv", SPEC, RENAMED)
    workspace.change()
    gated = workspace.gate()
    gated.assert_status(2)
    assert "R2B692" in gated.summary
    assert f"spec {SPEC}" in gated.summary


@SAMPLED
@only_nightly()
def test_a_new_spec_is_judged_alone(workspace: Workspace) -> None:
    workspace.change({"bench/other.r2b.yaml": spec(name="other")})
    gated = workspace.gate(spec="bench/other.r2b.yaml")
    gated.assert_status(0)
    assert re.search(f"New spec: {BASE}", gated.summary)
    assert "1 requirement of the baseline: not judged without a base." in gated.summary
    assert (gated.folder / "record.json").exists()


@only_nightly()
@SAMPLED
def test_a_base_that_fails_itself(workspace: Workspace) -> None:
    """It fails while it plays, as what may pass at the next attempt does."""
    source = (workspace.top / PACKAGE / "node.py").read_text()
    crashes = source.replace("smooth(self.cost_s)", "import os; os._exit(7)")
    workspace.change({f"{PACKAGE}/node.py": crashes}, on_main=True)
    workspace.change({f"{PACKAGE}/node.py": source})
    gated = workspace.gate(*ONE_PAIR)
    gated.assert_status(2)
    assert "R2B698" in gated.summary
    assert "--allow base" in gated.said


@only_nightly()
@SAMPLED
def test_a_base_that_fails_itself_can_be_left_out(workspace: Workspace) -> None:
    source = (workspace.top / PACKAGE / "cost.py").read_text()
    workspace.change({f"{PACKAGE}/cost.py": "raise RuntimeError('broken')\n"}, on_main=True)
    workspace.change({f"{PACKAGE}/cost.py": source})
    allowed = workspace.gate(*ONE_PAIR, allow="base")
    allowed.assert_status(0, 3)
    assert re.search(f"Allowed: base. {BASE}", allowed.summary)


@only_nightly()
@pytest.mark.parametrize("recipe", ["shell"])
def test_a_base_that_is_built_runs_what_was_built(workspace: Workspace) -> None:
    script = "mkdir -p out && cp -r src/blur/blur out/ && echo 'FACTOR = 1.0' >> out/blur/cost.py"
    base = {"build": [["sh", "-c", script]], "setup": f"PYTHONPATH=out:{workspace.site}"}
    benchmark = {"duration": "1 s", "rates": ["20 Hz"], "warm_up": "100 ms", "gate": {"base": base}}
    graph = {"nodes": {"blur": {"python": "blur.node.Blur"}}}
    workspace.change({SPEC: spec(benchmark=benchmark, graph=graph)}, on_main=True)
    (workspace.top / "out").symlink_to("src/blur")
    gated = workspace.gate(*ONE_PAIR, allow="base")
    gated.assert_status(0, 3)
    loaded = json.loads((gated.folder / "base/001/loaded_files.json").read_text())["blur"]
    assert any(path.endswith("tree/out/blur/cost.py") for path in loaded), loaded


@only_nightly()
@SAMPLED
def test_the_same_code_is_the_graph_against_itself(workspace: Workspace) -> None:
    gated = workspace.gate(*ONE_PAIR)
    gated.assert_status(0, 3)
    assert re.search(rf"Same spec as {BASE}\.", gated.summary)
    assert "Base and head have loaded the same code." in gated.summary


@SAMPLED
@only_nightly()
def test_a_shallow_clone_is_told_what_to_fetch(workspace: Workspace) -> None:
    workspace.set_cost(21.0)
    gated = workspace.shallow_clone().gate(base="origin/main")
    gated.assert_status(2)
    assert "R2B694" in gated.summary
    assert "git fetch --depth=1 origin main:refs/remotes/origin/main" in gated.summary


@SAMPLED
def test_a_side_that_loads_files_of_the_other_is_an_error(workspace: Workspace) -> None:
    absolute = f"import sys\nsys.path.insert(0, {str(workspace.head / PACKAGE)!r})\nimport cost\n"
    source = (workspace.top / PACKAGE / "node.py").read_text()
    workspace.change({f"{PACKAGE}/node.py": absolute + source}, on_main=True)
    workspace.set_cost(21.0)
    gated = workspace.gate(*ONE_PAIR)
    gated.assert_status(2)
    assert "R2B696" in gated.summary
    assert "of the head (" in gated.summary


@pytest.mark.parametrize("recipe", ["shell"])
def test_an_interrupted_gate_leaves_nothing(workspace: Workspace) -> None:
    process = subprocess.Popen(
        [sys.executable, "-m", "r2bspec", "gate", SPEC, "--base", "main", "--no-lock"],
        cwd=workspace.top,
        env=workspace.environment(),
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    assert process.stderr is not None
    for line in process.stderr:
        if "start 2 of at most" in line:
            break
    process.send_signal(signal.SIGTERM)
    process.communicate(timeout=120)
    assert process.returncode == 130


def test_the_page_has_this_table() -> None:
    page = (Path(__file__).parents[2] / "docs" / "gate.md").read_text()
    rows = dict(re.findall(r"^\| ([^|]+?) \| ([^|]+?) \|$", page, re.MULTILINE))
    assert {name: rows.get(name) for name in OUTCOMES} == OUTCOMES
