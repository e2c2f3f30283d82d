"""Pull requests through the merge gate, on real ROS 2: what each of them comes to.

The table of docs/gate.md has the expected outcomes; `test_the_page_has_this_table` compares it with
`OUTCOMES`. How often a comparison of starts errs is simulated (tests/simulation) and measured
(tests/bench/merge_gate.py): these tests assert only what no load of the machine can change.
"""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest

pytest.importorskip("rclpy")

from git_repositories import git
from pull_requests import PACKAGE, PARAMETERS, SPEC, Workspace, spec, without_sections
from ros_runs import nothing_left as nothing_left

OUTCOMES = {
    "neutral": "PASS",
    "node 15 % slower": "FAIL",
    "node 15 % faster": "PASS",
    "node crashes": "error, exit status 2 or 4",
    "parameter file changed": "judged; the report names the file",
    "dependency changed": "judged; the report names its file, or both versions",
    "objective weakened": "error R2B692, exit status 2",
    "objective deleted": "error R2B692, exit status 2",
    "all objectives deleted": "error R2B693, exit status 2",
    "spec deleted": "error R2B692, exit status 2",
    "spec renamed": "judged, against the base's spec of the same name",
    "new spec without a base": "the head alone is judged",
    "base that fails itself": "error R2B698; with `--allow base` the head alone",
    "base whose spec is broken": "error R2B698; with `--allow base` the head alone",
    "base that does not build": "error R2B695; with `--allow base` the head alone",
    "dirty work tree": "judged as it is; the report says `+dirty`",
    "same code on both sides": "the graph against itself, which the report says",
    "shallow clone without the base": "error R2B694, exit status 2, with what to fetch",
    "a side that loads files of the other": "error R2B696, exit status 2",
}
"""What a pull request is, and what the gate makes of it."""

ONE_PAIR = ("--pairs", "1")
"""Enough where only what is compared matters: a ratio of one pair is always open."""


@pytest.fixture
def workspace(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Workspace:
    temporary = tmp_path / "temporary"
    temporary.mkdir()
    monkeypatch.setenv("TMPDIR", str(temporary))
    return Workspace.create(tmp_path)


@pytest.fixture(autouse=True)
def no_tree_left(workspace: Workspace) -> object:
    """Every gate removes the work tree of its base, whatever happened."""
    yield
    left = list((workspace.top.parent / "temporary").glob("r2bspec-base-*"))
    assert left == []
    assert git(workspace.top, "worktree", "list").count("\n") == 0


def test_a_neutral_change_does_not_fail(workspace: Workspace) -> None:
    workspace.change(
        {f"{PACKAGE}/node.py": (workspace.top / PACKAGE / "node.py").read_text() + "# v2\n"}
    )
    gated = workspace.gate()
    gated.assert_status(0, 3)
    first = gated.stdout.splitlines()[0]
    assert re.search(r"node\.py changed", first), first
    record = json.loads((gated.folder / "pairs.json").read_text())
    assert record["against"].startswith("main@")
    loaded = json.loads((gated.folder / "base/001/loaded_files.json").read_text())["blur"]
    assert any("/r2bspec-base-" in path and path.endswith("blur/cost.py") for path in loaded)
    loaded = json.loads((gated.folder / "head/001/loaded_files.json").read_text())["blur"]
    assert str(workspace.top / PACKAGE / "cost.py") in loaded


def test_a_slower_node_does_not_pass(workspace: Workspace) -> None:
    workspace.set_cost(23.0)
    gated = workspace.gate()
    gated.assert_status(1, 3)
    assert re.search(r"main@\w{7}.*cost\.py changed", gated.stdout.splitlines()[0])
    result = json.loads((gated.folder / "result.json").read_text())
    (ratio,) = [one for one in result["verdict"]["requirements"] if one["objective"] == "fast"]
    assert ratio["estimate"] > 1.05


def test_a_faster_node_does_not_fail(workspace: Workspace) -> None:
    workspace.set_cost(17.0)
    workspace.gate("--pairs", "2").assert_status(0, 3)


def test_a_node_that_crashes_is_the_heads_failure(workspace: Workspace) -> None:
    workspace.change({f"{PACKAGE}/cost.py": "raise RuntimeError('no such kernel')\n"})
    gated = workspace.gate(*ONE_PAIR)
    gated.assert_status(2, 4)
    assert "no such kernel" in gated.said
    assert "R2B698" not in gated.said


def test_a_parameter_file_is_a_part_of_the_graph(workspace: Workspace) -> None:
    workspace.change({PARAMETERS: "/**:\n  ros__parameters:\n    cost_ms: 21.0\n"})
    gated = workspace.gate(*ONE_PAIR)
    gated.assert_status(0, 1, 3)
    assert "blur.yaml changed" in gated.stdout.splitlines()[0]


def test_a_dependency_is_a_part_of_the_graph(workspace: Workspace) -> None:
    # Both sides find the dependency of the pipeline; a stored run has that of its day.
    workspace.gate("--output", str(workspace.top.parent / "stored"), against="").assert_status(0, 3)
    workspace.install_dependency("1.1", factor=1.01)
    gated = workspace.gate("--baseline", str(workspace.top.parent / "stored"), against="")
    gated.assert_status(0, 3)
    assert "kernels.py changed" in gated.stdout.splitlines()[0]


def test_an_objective_that_is_weakened_is_an_error_at_its_line(workspace: Workspace) -> None:
    workspace.change({SPEC: spec().replace("107 % of", "150 % of")})
    gated = workspace.gate()
    gated.assert_status(2)
    assert re.search(rf"{SPEC}:\d+:\d+: error\[R2B692 weaker-gate\].*150 %.*107 %", gated.stderr)
    assert "--allow 'objective fast'" in gated.stderr
    allowed = workspace.gate("--allow", "objective fast", *ONE_PAIR)
    allowed.assert_status(0, 1, 3)
    assert "allowed: objective fast" in allowed.stdout.lower()


def test_objectives_that_are_deleted(workspace: Workspace) -> None:
    one_left = {"arrives": {"at": "20 Hz", "require": ["received > 0"]}}
    workspace.change({SPEC: spec(slos=one_left)})
    gated = workspace.gate()
    gated.assert_status(2)
    assert "R2B692" in gated.stderr
    assert "objective fast" in gated.stderr
    workspace.change({SPEC: without_sections("slos")})
    gated = workspace.gate()
    gated.assert_status(2)
    assert "R2B693 missing-objectives" in gated.stderr


def test_a_spec_that_is_deleted_or_renamed(workspace: Workspace) -> None:
    git(workspace.top, "mv", SPEC, "bench/renamed.r2b.yaml")
    workspace.change()
    gated = workspace.gate(SPEC)
    gated.assert_status(2)
    assert "R2B692" in gated.stderr
    assert f"spec {SPEC}" in gated.stderr
    assert "bench/renamed.r2b.yaml" in gated.stderr
    by_new_path = workspace.gate("bench/renamed.r2b.yaml", *ONE_PAIR)
    by_new_path.assert_status(0, 3)
    assert f"Renamed: the spec is {SPEC} in main@" in by_new_path.stdout
    git(workspace.top, "rm", "--quiet", "bench/renamed.r2b.yaml")
    workspace.change({"bench/other.r2b.yaml": spec(name="other")})
    gated = workspace.gate("bench")
    gated.assert_status(2)
    assert f"spec {SPEC}" in gated.stderr
    assert "starting the graph" not in gated.stderr


def test_a_new_spec_is_judged_alone(workspace: Workspace) -> None:
    workspace.change({"bench/other.r2b.yaml": spec(name="other")})
    gated = workspace.gate("bench/other.r2b.yaml")
    gated.assert_status(0)
    assert "New spec: main@" in gated.stdout
    assert "1 requirement of the baseline: not judged without a base." in gated.stdout
    assert (gated.folder / "record.json").exists()


def test_a_base_that_fails_itself(workspace: Workspace) -> None:
    source = (workspace.top / PACKAGE / "cost.py").read_text()
    workspace.change({f"{PACKAGE}/cost.py": "raise RuntimeError('broken')\n"}, on_main=True)
    workspace.change({f"{PACKAGE}/cost.py": source})
    gated = workspace.gate(*ONE_PAIR)
    gated.assert_status(2, 4)
    assert "R2B698" in gated.stderr
    assert "--allow base" in gated.stderr
    allowed = workspace.gate("--allow", "base", *ONE_PAIR)
    allowed.assert_status(0, 3)
    assert "Allowed: base. main@" in allowed.stdout


def test_a_base_whose_spec_is_broken(workspace: Workspace) -> None:
    workspace.change({SPEC: spec() + "nonsense: 1\n"}, on_main=True)
    workspace.change({SPEC: spec()})
    gated = workspace.gate(*ONE_PAIR)
    gated.assert_status(2)
    assert re.search(rf"R2B698.*main@\w+ cannot be compared with: {SPEC}", gated.stderr)
    allowed = workspace.gate("--allow", "base", *ONE_PAIR)
    allowed.assert_status(0, 3)


def test_a_base_that_does_not_build(workspace: Workspace) -> None:
    benchmark = {
        "duration": "1 s",
        "rates": ["20 Hz"],
        "gate": {"base": {"build": [["sh", "-c", "echo 'no compiler' >&2; exit 3"]]}},
    }
    workspace.change({SPEC: spec(benchmark=benchmark)}, on_main=True)
    workspace.change({f"{PACKAGE}/new.py": ""})
    gated = workspace.gate(*ONE_PAIR)
    gated.assert_status(2)
    assert "R2B695" in gated.stderr
    assert "no compiler" in gated.stderr
    assert "--allow base" in gated.stderr


def test_a_base_that_is_built_runs_what_was_built(workspace: Workspace) -> None:
    script = "mkdir -p out && cp -r src/blur/blur out/ && echo 'FACTOR = 1.0' >> out/blur/cost.py"
    base = {"build": [["sh", "-c", script]], "setup": f"PYTHONPATH=out:{workspace.site}"}
    benchmark = {"duration": "1 s", "rates": ["20 Hz"], "warm_up": "100 ms", "gate": {"base": base}}
    graph = {"nodes": {"blur": {"python": "blur.node.Blur"}}}
    workspace.change({SPEC: spec(benchmark=benchmark, graph=graph)}, on_main=True)
    (workspace.top / "out").symlink_to("src/blur")
    gated = workspace.gate(*ONE_PAIR, "--allow", "base")
    gated.assert_status(0, 3)
    loaded = json.loads((gated.folder / "base/001/loaded_files.json").read_text())["blur"]
    assert any(path.endswith("tree/out/blur/cost.py") for path in loaded), loaded


def test_a_dirty_work_tree_is_judged_as_it_is(workspace: Workspace) -> None:
    with (workspace.top / PACKAGE / "cost.py").open("a") as file:
        file.write("# not committed\n")
    gated = workspace.gate(*ONE_PAIR)
    gated.assert_status(0, 3)
    assert "+dirty" in gated.stdout
    assert "cost.py changed" in gated.stdout.splitlines()[0]


def test_the_same_code_is_the_graph_against_itself(workspace: Workspace) -> None:
    gated = workspace.gate(*ONE_PAIR)
    gated.assert_status(0, 3)
    assert "Same spec and same code as main@" in gated.stdout


def test_a_shallow_clone_is_told_what_to_fetch(workspace: Workspace) -> None:
    workspace.set_cost(21.0)
    clone = workspace.top.parent / "clone"
    url = f"file://{workspace.top}"
    git(workspace.top.parent, "clone", "--quiet", "--depth=1", "--branch=change", url, str(clone))
    gated = Workspace(clone, workspace.site).gate(against="origin/main")
    gated.assert_status(2)
    assert "R2B694" in gated.stderr
    assert "git fetch --depth=1 origin main:refs/remotes/origin/main" in gated.stderr


def test_a_side_that_loads_files_of_the_other_is_an_error(workspace: Workspace) -> None:
    absolute = f"import sys\nsys.path.insert(0, {str(workspace.top / 'src/blur')!r})\n"
    source = (workspace.top / PACKAGE / "node.py").read_text()
    workspace.change({f"{PACKAGE}/node.py": absolute + source}, on_main=True)
    workspace.set_cost(21.0)
    gated = workspace.gate(*ONE_PAIR)
    gated.assert_status(2)
    assert "R2B696" in gated.stderr
    assert "of the head (" in gated.stderr


def test_an_interrupted_gate_leaves_nothing(workspace: Workspace) -> None:
    import signal
    import subprocess
    import sys

    process = subprocess.Popen(
        [sys.executable, "-m", "r2bspec", "run", SPEC, "--against", "main", "--no-lock"],
        cwd=workspace.top,
        env=workspace.environment(),
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    assert process.stderr is not None
    for line in process.stderr:
        if "starting the graph" in line:
            break
    process.send_signal(signal.SIGTERM)
    process.communicate(timeout=120)
    assert process.returncode == 130


def test_the_page_has_this_table() -> None:
    page = (Path(__file__).parents[2] / "docs" / "gate.md").read_text()
    rows = dict(re.findall(r"^\| ([^|]+?) \| ([^|]+?) \|$", page, re.MULTILINE))
    assert {name: rows.get(name) for name in OUTCOMES} == OUTCOMES
