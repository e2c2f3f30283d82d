"""What may change a verdict after it was reached: a second session, a level."""

from __future__ import annotations

from pathlib import Path

import msgspec
import numpy as np
import pytest

from r2bspec.judge.confirmation import confirm_run, needs_confirmation
from r2bspec.judge.pipeline import judge
from r2bspec.judge.verdict import InconclusivePolicy, Level, Outcome, Verdict, outcome_of
from r2bspec.measure.run_samples import read_samples
from run_simulation import Played, Simulation, objective

FAST = np.full(300, 0.02)
SLOW = np.where(np.arange(300) % 5 == 0, 0.1, 0.02)
SOME = np.where(np.arange(300) % 100 == 50, 0.1, 0.02)
LATENCIES = {"pass": FAST, "fail": SLOW, "inconclusive": SOME}
ASKED = "latency.p99 < 60 ms"


def batch(path: Path, outcome: str, requirement: str = ASKED) -> Verdict:
    run = Simulation(segments=[Played(30, LATENCIES[outcome])] * 2).write(path / outcome)
    found = judge({"slo": objective(requirement)}, read_samples(run))
    assert found.outcome == outcome
    return found


class TestConfirmation:
    @pytest.mark.parametrize(
        ("second", "together"),
        [("fail", "fail"), ("inconclusive", "inconclusive"), ("pass", "inconclusive")],
    )
    def test_a_failure_must_be_found_twice(
        self, tmp_path: Path, second: str, together: str
    ) -> None:
        first = batch(tmp_path / "first", "fail")
        assert needs_confirmation(first)
        found = confirm_run(first, batch(tmp_path / "second", second))
        assert found.outcome == found.requirements[0].outcome == together
        assert "second run" in found.requirements[0].notes[-1]
        assert bool(found.requirements[0].remedy) == (together == "inconclusive")

    @pytest.mark.parametrize("first", ["pass", "inconclusive"])
    def test_nothing_else_is_tried_again(self, tmp_path: Path, first: str) -> None:
        found = batch(tmp_path, first)
        assert not needs_confirmation(found)
        assert confirm_run(found, found).requirements == found.requirements

    def test_a_batch_that_broke_confirms_nothing(self, tmp_path: Path) -> None:
        first = batch(tmp_path / "first", "fail")
        broken = msgspec.structs.replace(first, outcome="invalid")
        assert confirm_run(first, broken).outcome == "inconclusive"


class TestSeverity:
    @pytest.mark.parametrize(
        ("levels", "outcomes", "policy", "overall"),
        [
            (("error", "error"), ("pass", "fail"), "report", "fail"),
            (("error", "warn"), ("pass", "fail"), "report", "pass"),
            (("error", "info"), ("pass", "inconclusive"), "report", "pass"),
            (("error",), ("inconclusive",), "report", "inconclusive"),
            (("error",), ("inconclusive",), "fail", "fail"),
            (("error",), ("inconclusive",), "pass", "pass"),
            (("error", "error"), ("inconclusive", "fail"), "pass", "fail"),
            (("warn",), ("fail",), "fail", "pass"),
        ],
    )
    def test_levels_and_the_policy(
        self,
        tmp_path: Path,
        levels: tuple[Level, ...],
        outcomes: tuple[Outcome, ...],
        policy: InconclusivePolicy,
        overall: str,
    ) -> None:
        (one,) = batch(tmp_path, "pass").requirements
        requirements = [
            msgspec.structs.replace(one, level=level, outcome=outcome)
            for level, outcome in zip(levels, outcomes, strict=True)
        ]
        found, sentence = outcome_of(requirements, policy)
        assert found == overall
        assert ("warning" in sentence) == (
            any(
                level == "warn" and outcome != "pass"
                for level, outcome in zip(levels, outcomes, strict=True)
            )
            or (policy == "pass" and "inconclusive" in outcomes)
        )

    def test_what_is_off_is_not_judged(self, tmp_path: Path) -> None:
        run = Simulation(segments=[Played(30, SLOW)]).write(tmp_path)
        off = msgspec.structs.replace(objective(ASKED), level="off")
        assert judge({"slo": off}, read_samples(run)).requirements == ()

    def test_an_objective_has_a_confidence_of_its_own(self, tmp_path: Path) -> None:
        from r2bspec.language.quantities import Share

        run = Simulation(segments=[Played(30, FAST)]).write(tmp_path)
        sure = msgspec.structs.replace(objective(ASKED), confidence=Share(0.99))
        found = judge({"slo": sure}, read_samples(run)).requirements[0]
        assert (found.outcome, found.confidence) == ("inconclusive", 0.99)
