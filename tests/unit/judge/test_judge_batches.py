"""A run that failed and its confirmation session, read from one folder and judged together."""

from __future__ import annotations

from pathlib import Path

import msgspec
import numpy as np
import pytest

from r2bspec.judge.confirmation import confirm_run
from r2bspec.judge.decision_policy import DecisionPolicy
from r2bspec.judge.judge_run import judge_with_confirmation, result_of
from r2bspec.judge.measure.run_samples import read_samples
from r2bspec.judge.pipeline import judge
from r2bspec.language.quantities import Share
from r2bspec.record.run_folder import Run
from r2bspec.record.run_record import ConfirmationRecord, SearchRecord
from run_simulation import Played, Simulation, objective, probe

FAST = np.full(300, 0.02)
SLOW = np.where(np.arange(300) % 5 == 0, 0.1, 0.02)
SOME = np.where(np.arange(300) % 100 == 50, 0.1, 0.02)
REQUIRED = {"slo": objective("latency.p99 < 60 ms")}
NOTHING = ConfirmationRecord(search=None, sustained=())


def simulated(path: Path, first: np.ndarray, second: np.ndarray | None) -> Run:
    segments = [Played(30, first)] * 2
    if second is not None:
        segments += [Played(30, second, kind="confirmation")] * 2
    return Simulation(
        segments=segments,
        objectives=REQUIRED,
        confirmation=NOTHING if second is not None else None,
    ).write(path)


def search(holds_hz: float, fails_hz: float, segment: str) -> SearchRecord:
    tried = msgspec.structs.replace(probe(holds_hz, holds=True), segment=segment)
    return SearchRecord(probes=(tried,), holds_hz=holds_hz, fails_hz=fails_hz, limited_by="graph")


@pytest.mark.parametrize(
    ("second", "together", "said"),
    [
        (SLOW, "fail", "Confirmed by a second run in new processes."),
        (FAST, "inconclusive", "did not confirm"),
        (SOME, "inconclusive", "did not confirm"),
        (None, "fail", "No second run"),
    ],
)
def test_a_failure_is_judged_with_its_fresh_batch(
    tmp_path: Path, second: np.ndarray | None, together: str, said: str
) -> None:
    verdict = result_of(simulated(tmp_path, SLOW, second)).verdict
    (judged,) = verdict.requirements
    assert verdict.outcome == judged.outcome == together
    assert said in verdict.reason
    assert second is None or "second run" in judged.notes[-1]
    assert bool(judged.remedy) == (together == "inconclusive")


def test_a_batch_that_broke_confirms_nothing(tmp_path: Path) -> None:
    first = judge(REQUIRED, read_samples(simulated(tmp_path, SLOW, None)))
    found = confirm_run(first, msgspec.structs.replace(first, outcome="invalid"))
    assert found.outcome == found.requirements[0].outcome == "inconclusive"
    assert found.requirements[0].remedy


def test_the_fresh_batch_is_judged_at_its_own_confidence(tmp_path: Path) -> None:
    sure = msgspec.structs.replace(REQUIRED["slo"], confidence=Share.parse("99.9 %"))
    samples = read_samples(simulated(tmp_path, SLOW, SLOW))
    verdict = judge_with_confirmation({"slo": sure}, samples, DecisionPolicy())
    assert verdict.outcome == "fail"
    assert verdict.requirements[0].confidence == 0.999
    assert "90 %" in verdict.requirements[0].notes[-1]


class TestSearches:
    def run(self, path: Path, again: SearchRecord | None) -> Run:
        return Simulation(
            segments=[Played(80, FAST, kind="probe"), Played(80, FAST, kind="confirmation")],
            objectives={"peak": objective("peak.rate >= 100 Hz", at="")},
            search=search(80, 82, "probe-001"),
            confirmation=ConfirmationRecord(search=again, sustained=()),
        ).write(path)

    def test_a_peak_is_searched_again(self, tmp_path: Path) -> None:
        low = self.run(tmp_path / "low", search(81, 83, "confirmation-002"))
        assert result_of(low).verdict.outcome == "fail"
        high = self.run(tmp_path / "high", search(120, 123, "confirmation-002"))
        assert result_of(high).verdict.outcome == "inconclusive"


def test_a_policy_that_fails_the_open_does_not_call_it_confirmed(tmp_path: Path) -> None:
    samples = read_samples(simulated(tmp_path, SLOW, FAST))
    verdict = judge_with_confirmation(REQUIRED, samples, DecisionPolicy(inconclusive="fail"))
    assert verdict.outcome == "fail"
    assert "did not confirm" in verdict.reason
