"""What was not played is said in every report, and in the verdict where it is more than 5 %."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import msgspec
import numpy as np
import pytest

from r2bspec.compare.report_input import ReportInput
from r2bspec.judge.judge_run import result_of
from r2bspec.record.comparison_folder import merge_runs
from r2bspec.record.run_folder import Run
from r2bspec.record.run_record import UnplayedMessages
from r2bspec.report.format_registry import renderer
from run_simulation import Played, Simulation, objective

FEW = UnplayedMessages(topic="/r2b/right", count=1, total=56)
SOME = UnplayedMessages(topic="/r2b/right", count=10, total=56)
MOST = UnplayedMessages(topic="/r2b/right", count=53, total=56)
AGREED = msgspec.structs.replace(MOST, agreed=True)


def unplayed_run(path: Path, *unplayed: UnplayedMessages) -> Run:
    run = Simulation(
        segments=[Played(30, np.full(90, 0.02))],
        objectives={"all": objective("latency.p50 < 50 ms")},
    ).write(path)
    return replace(run, record=msgspec.structs.replace(run.record, unplayed=unplayed))


@pytest.mark.parametrize(
    ("one", "in_verdict", "command"),
    [(FEW, False, "::notice "), (SOME, True, "::warning "), (AGREED, False, "::notice ")],
)
def test_above_5_percent_it_is_a_warning_in_the_verdict_unless_agreed(
    tmp_path: Path, one: UnplayedMessages, in_verdict: bool, command: str
) -> None:
    found = result_of(unplayed_run(tmp_path, one))
    assert found.verdict.outcome == "pass"
    assert (one.text in found.verdict.reason) == in_verdict
    lines = renderer("github")(ReportInput(result=found)).decode().splitlines()
    (line,) = (
        output_line
        for output_line in lines
        if "r2b/right" in output_line and "simulated%3A pass" not in output_line
    )
    assert line.startswith(command)


def test_runs_as_one_say_it_once(tmp_path: Path) -> None:
    runs = [unplayed_run(tmp_path / name, SOME) for name in "ab"]
    merged = merge_runs(runs, folder=tmp_path, plan=runs[0].plan, whole=runs[0].record)
    assert merged.record.unplayed == (SOME,)
