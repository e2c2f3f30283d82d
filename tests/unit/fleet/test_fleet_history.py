"""Runs that hosts made are judged by the history of the client as runs made here are."""

from __future__ import annotations

from pathlib import Path

import msgspec
import pytest

from pair_simulation import latencies
from r2bspec.compare.history import open_history
from r2bspec.fleet.fleet_runs import FleetHistory
from r2bspec.judge.result import Result
from r2bspec.record.baseline_file import CONFIRMATION_FOLDER
from r2bspec.record.run_folder import RunFolder, open_run
from run_simulation import Played, Simulation, objective

NO_REGRESSION = {"no_regression": objective("latency.p50 <= 110 % of baseline")}
LEVELS = [0.020, 0.0204, 0.0197, 0.0201, 0.0199, 0.0202]


class Night:
    """Folders as they come from one host, one after the other."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.file = folder / "history.sqlite"
        self.history = FleetHistory(self.file)
        self.made = 0

    def fetched(self, path: Path, level_s: float) -> Path:
        self.made += 1
        simulation = Simulation(
            segments=[Played(30.0, latencies(level_s))], objectives=NO_REGRESSION
        )
        run = simulation.write(path)
        RunFolder(path).write_record(
            msgspec.structs.replace(run.record, run_id=f"{self.made:016x}")
        )
        return path

    def run(self, level_s: float, again_s: float = 0.0) -> Result:
        from r2bspec.compare.report_input import read_folder

        path = self.fetched(self.folder / f"run{self.made}", level_s)
        plan = self.history.confirmation(path, open_run(path).plan)
        assert (plan is not None) == (again_s > 0)
        if plan is not None:
            assert not plan.gate.confirm
            self.fetched(path / CONFIRMATION_FOLDER, again_s)
        self.history.add(path)
        return read_folder(path).result


@pytest.fixture
def night(tmp_path: Path) -> Night:
    return Night(tmp_path)


def test_a_night_is_judged_by_the_nights_before_it(night: Night) -> None:
    verdicts = [night.run(level).verdict for level in LEVELS]
    assert [verdict.requirements[0].outcome for verdict in verdicts] == ["inconclusive"] * 5 + [
        "pass"
    ]
    assert verdicts[2].requirements[0].learning == "3 of 5"
    with open_history(night.file) as history:
        assert len(history.runs()) == len(LEVELS)


def test_a_failure_needs_a_second_run_that_confirms_it(night: Night) -> None:
    for level in LEVELS:
        night.run(level)
    assert night.run(0.03, again_s=0.03).verdict.outcome == "fail"
    assert night.run(0.03, again_s=0.02).verdict.outcome == "inconclusive"
