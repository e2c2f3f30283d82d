"""``r2bspec trend``: which results make a history, and what is said of it."""

from __future__ import annotations

import csv
import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import msgspec
import pytest

from command_line import Call
from command_line import call as call
from git_repositories import commit as commit_files
from git_repositories import git
from histories import commit, noisy, result_of_commit, some_result, write_history
from page_blocks import ROOT
from r2bspec.compare.history import History, read_histories
from r2bspec.judge.judge_run import to_json
from r2bspec.judge.result import Result
from r2bspec.report.trend_document import render

P50 = "latency.p50"


@pytest.fixture(scope="module")
def result(tmp_path_factory: pytest.TempPathFactory) -> Result:
    return some_result(tmp_path_factory.mktemp("run") / "run")


@pytest.fixture(scope="module")
def slower(result: Result, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Forty results, from the 25th on slower by 12 %."""
    folder = tmp_path_factory.mktemp("slower")
    write_history(folder, result, noisy(40, {25: 1.12}))
    return folder


def history(*paths: Path) -> History:
    (found,), _ = read_histories(paths)
    return found


def changes(found: History, name: str = P50) -> list[tuple[int, int, str]]:
    (metric,) = (metric for metric in found.metrics if metric.metric == name)
    return [(change.before, change.after, change.outcome) for change in metric.changes]


def test_a_change_has_the_commits_before_and_after_it(slower: Path) -> None:
    found = history(slower)
    assert changes(found) == [(24, 25, "worse")]
    assert changes(found, "throughput.mean") == [(24, 25, "improved")]
    text = render("text", [found], ()).decode()
    assert f"since {commit(25)[:7]} (last before: {commit(24)[:7]})" in text


@pytest.mark.parametrize(
    "other",
    [
        lambda result: {"machine": {**result.machine, "cpu": "another"}},
        lambda result: {"versions": {**result.versions, "rmw": "another"}},
        lambda result: {"dataset": {**result.dataset, "sha256": "another"}},
    ],
    ids=["machine", "version", "data"],
)
def test_no_change_is_between_results_of_different_environments(
    tmp_path: Path, result: Result, other: Any
) -> None:
    write_history(tmp_path, result, noisy(40, {20: 1.5}))
    elsewhere = msgspec.structs.replace(result, **other(result))
    for number in range(20, 40):
        made = result_of_commit(elsewhere, number, noisy(40, {20: 1.5})[number])
        (tmp_path / f"{number:04}.json").write_bytes(to_json(made))
    found = history(tmp_path)
    assert len(found.environments) == 2
    assert changes(found) == []
    assert "another" in render("text", [found], ()).decode()


def test_results_of_two_machines_by_turns_are_two_histories(tmp_path: Path, result: Result) -> None:
    faster = msgspec.structs.replace(result, machine={**result.machine, "cpu": "another"})
    for number, factor in enumerate(noisy(60, {30: 1.12})):
        on, speed = (faster, 0.5) if number % 2 else (result, 1.0)
        made = result_of_commit(on, number, factor * speed)
        (tmp_path / f"{number:04}.json").write_bytes(to_json(made))
    assert changes(history(tmp_path)) == [(28, 30, "worse"), (29, 31, "worse")]


def test_files_that_are_no_results_are_named_and_left_out(
    call: Call, tmp_path: Path, slower: Path, result: Result
) -> None:
    (tmp_path / "foreign.json").write_text('{"a": 1}')
    (tmp_path / "broken.json").write_text('{"r2bspec_result": 1, ')
    (tmp_path / "binary.json").write_bytes(bytes(range(256)))
    (tmp_path / "gone.json").symlink_to("nothing")
    (tmp_path / "note.txt").write_text("not looked at")
    incomplete = msgspec.structs.replace(result, status="incomplete", reason="was killed")
    (tmp_path / "killed.json").write_bytes(to_json(incomplete))
    (tmp_path / "unjudged" / "head").mkdir(parents=True)
    (tmp_path / "unjudged" / "record.json").write_text("{}")
    (tmp_path / "unjudged" / "head" / "record.json").write_text("{}")
    said = call("trend", tmp_path, slower, status=0).out
    names = ("foreign", "broken", "binary", "gone", "killed", "unjudged/result")
    assert all(f"{name}.json" in said for name in names)
    assert "head" not in said
    assert "note.txt" not in said


@pytest.mark.parametrize(("number", "is_said"), [(1, True), (5, True), (6, False)])
def test_it_is_said_if_there_are_too_few_results_for_a_change_point(
    tmp_path: Path, result: Result, number: int, is_said: bool
) -> None:
    write_history(tmp_path, result, noisy(number, {}))
    text = render("text", [history(tmp_path)], ()).decode()
    assert ("A change point takes at least 6 results" in text) is is_said
    assert ("1 result: b6589fc" in text) is (number == 1)


def test_a_folder_without_results_is_an_error(call: Call, tmp_path: Path) -> None:
    assert "no result was found" in call("trend", tmp_path, status=2).err


def test_a_run_folder_counts_once_and_its_parts_do_not(tmp_path: Path, result: Result) -> None:
    artifact = tmp_path / "artifact"
    for name in ("run", "run/head/001", "reports"):
        (artifact / name).mkdir(parents=True)
        part = msgspec.structs.replace(result, run_id=name if "head" in name else "whole")
        (artifact / name / "result.json").write_bytes(to_json(part))
    (artifact / "run" / "pairs.json").write_text("{}")
    assert [one.run_id for one in history(tmp_path).results] == ["whole"]


def test_results_of_several_benchmarks_are_several_histories(
    call: Call, tmp_path: Path, slower: Path, result: Result
) -> None:
    other = msgspec.structs.replace(result, name="other", run_id="other")
    (tmp_path / "other.json").write_bytes(to_json(other))
    arguments = ["trend", slower, tmp_path, "--report"]
    found, _ = read_histories([slower, tmp_path])
    assert [one.name for one in found] == ["other", "simulated"]
    assert "{name}" in call(*arguments, f"csv={tmp_path}/all.csv", status=2).err
    call(*arguments, f"csv={tmp_path}/{{name}}.csv", status=0)
    assert (tmp_path / "other.csv").exists()


def test_csv_has_a_row_for_each_result_with_time_and_commit(slower: Path) -> None:
    text = render("csv", [history(slower)], ()).decode()
    rows = [*csv.DictReader(text.splitlines())]
    assert [row["commit"] for row in rows] == [commit(number) for number in range(40)]
    assert rows[0]["time"] == "2026-01-01T00:00:00+00:00"
    assert all(float(row["detections.latency.p50@30Hz"]) > 0 for row in rows)


def test_json_has_every_value_and_change(slower: Path) -> None:
    content = json.loads(render("json", [history(slower)], ["a.json is foreign"]))
    (found,) = content["histories"]
    assert len(found["results"]) == 40
    assert content["left_out"] == ["a.json is foreign"]
    (p50,) = (metric for metric in found["metrics"] if metric["metric"] == P50)
    assert len(p50["values"]) == 40
    assert p50["changes"][0]["confidence"] > 0.999


def test_the_script_of_pipelines_keeps_results_and_page_in_a_branch(
    tmp_path: Path, result: Result
) -> None:
    upstream, work = tmp_path / "upstream", tmp_path / "work"
    upstream.mkdir()
    git(upstream, "init", "--quiet", "--bare")
    git(tmp_path, "clone", "--quiet", str(upstream), "work")
    for number in range(2):
        commit_files(work, {"code.py": f"{number}"})
        run = tmp_path / f"run{number}"
        run.mkdir()
        (run / "result.json").write_bytes(to_json(result_of_commit(result, number, 1.0)))
        script = ROOT / "ci/shell/keep_results.sh"
        environment = {**os.environ, "R2BSPEC_PYTHON": sys.executable}
        subprocess.run(["/bin/sh", script, run], cwd=work, env=environment, check=True)
    kept = git(upstream, "ls-tree", "-r", "--name-only", "benchmarks").split()
    assert sum(name.startswith("results/") for name in kept) == 2
    assert "index.html" in kept
    assert git(work, "worktree", "list").count("\n") == 0
