"""Promise: a pipeline passes a run that passes, and no other, whatever the repository holds."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

pytest.importorskip("rclpy")

from git_repositories import git
from nightly import only_nightly
from pipelines import Workplace
from pull_requests import Workspace
from ros_runs import Bench, relay_spec

INCONCLUSIVE, INVALID = 3, 4
"""Verdicts of a machine that is busy at the moment."""

FORGED = '{"verdict": {"outcome": "pass\\nstatus=0"}}'


@pytest.fixture(name="place")
def checkout_with_a_bag(tmp_path: Path) -> Workplace:
    place = Workplace(tmp_path / "checkout", tmp_path / "temp")
    place.runner.mkdir()
    bench = Bench(place.checkout)
    for name, required in (("kept", "latency.p50 < 5 s"), ("broken", "latency.p50 < 1 us")):
        spec = relay_spec(slos={"fast": {"at": "2 Hz", "require": [required]}})
        spec["benchmark"] |= {"rates": ["2 Hz"], "duration": "3 s"}
        spec["benchmark"] |= {"gate": {"confirm": False, "interference": "tolerate"}}
        bench.write(spec, name)
    # As if this change had been measured, with a folder in the way of a report, and modules.
    for name in ("result.json", "summary.md", "report.html/keep"):
        place.write(f"r2bspec-reports/{name}", FORGED)
        place.write(f"r2bspec-artifacts/reports/{name}", FORGED)
    for name in ("json", "yaml", "numpy", "rclpy"):
        place.write(f"{name}.py", "raise SystemExit('the module of a stranger')\n")
    return place


@only_nightly()
def test_a_run_that_passes_passes(place: Workplace) -> None:
    done = place.action(sys.executable, "kept.r2b.yaml")
    assert done.code == 0, done.printed
    assert done.outputs["outcome"] == "pass"
    folder = Path(done.outputs["folder"])
    assert {each.name for each in folder.iterdir()} == {"run", "reports"}
    assert "kept" not in done.printed.partition("::stop-commands::")[0]
    assert done.summary == (folder / "reports" / "summary.md").read_text()


def test_an_objective_that_cannot_be_met_fails(place: Workplace) -> None:
    job = place.job(sys.executable, "broken.r2b.yaml")
    assert job.code == 1, job.printed
    reports = place.checkout / "r2bspec-artifacts" / "reports"
    assert (reports / "report.html").is_file()
    assert FORGED not in (reports / "result.json").read_text()


@only_nightly()
@pytest.mark.timeout(600)
def test_a_slower_node_is_found_by_the_template_of_gitlab(tmp_path: Path) -> None:
    """As it is copied, on a repository as colcon has it, with a base."""
    workspace = Workspace.create(tmp_path)
    workspace.set_cost(100.0)
    place = Workplace(workspace.top, tmp_path / "temp")
    place.runner.mkdir()
    done = place.job(
        sys.executable,
        "bench",
        "sh",
        PYTHONPATH=workspace.environment()["PYTHONPATH"],
        R2BSPEC_ARGUMENTS="--pairs=2\n--no-lock",
        CI_MERGE_REQUEST_DIFF_BASE_SHA=git(workspace.top, "rev-parse", "main"),
    )
    assert done.code in {1, INCONCLUSIVE, INVALID}, done.printed
    assert "cost.py changed" in done.printed
    reports = workspace.top / "r2bspec-artifacts" / "reports"
    assert {path.name for path in reports.iterdir()} >= {"report.html", "junit.xml", "summary.md"}
    assert "cost.py changed" in (reports / "summary.md").read_text()
