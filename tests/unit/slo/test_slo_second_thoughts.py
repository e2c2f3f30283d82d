"""What may change a verdict after it was reached: a fresh batch, a disturbed machine, a level."""

from __future__ import annotations

from pathlib import Path

import msgspec
import numpy as np
import pytest

from r2bspec.measure.samples import read_samples
from r2bspec.slo.confirmation import confirm_run, wants_confirmation
from r2bspec.slo.disturbance import Surroundings, find_disturbed, foreign_cores
from r2bspec.slo.judge import judge
from r2bspec.slo.model import Level, Outcome, Verdict
from r2bspec.slo.severity import Policy, outcome_of
from r2bspec.slo.terms import Disturbed, Terms
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
        assert wants_confirmation(first)
        found = confirm_run(first, batch(tmp_path / "second", second))
        assert found.outcome == found.requirements[0].outcome == together
        assert "fresh" in found.requirements[0].notes[-1]
        assert bool(found.requirements[0].settle) == (together == "inconclusive")

    @pytest.mark.parametrize("first", ["pass", "inconclusive"])
    def test_nothing_else_is_tried_again(self, tmp_path: Path, first: str) -> None:
        found = batch(tmp_path, first)
        assert not wants_confirmation(found)
        assert confirm_run(found, found).requirements == found.requirements

    def test_a_batch_that_broke_confirms_nothing(self, tmp_path: Path) -> None:
        first = batch(tmp_path / "first", "fail")
        broken = msgspec.structs.replace(first, outcome="invalid")
        assert confirm_run(first, broken).outcome == "inconclusive"


class TestDisturbance:
    QUIET = Surroundings(
        cores=8, steal=0.0, foreign_cores=0.1, pressure=0.05, throttled_s=0.0, calibration=1.0
    )

    @pytest.mark.parametrize(
        ("field", "value", "word"),
        [
            ("steal", 0.02, "stolen"),
            ("foreign_cores", 1.0, "other processes"),
            ("pressure", 0.3, "waited"),
            ("throttled_s", 0.2, "throttled"),
            ("calibration", 2.0, "harness alone"),
        ],
    )
    def test_one_thing_is_enough(self, field: str, value: float, word: str) -> None:
        from dataclasses import replace

        odd = replace(self.QUIET, **{field: value})  # type: ignore[arg-type]
        quiet, found, _ = find_disturbed([self.QUIET, odd, self.QUIET])
        assert quiet == ()
        assert len(found) == 1
        assert word in found[0]

    def test_what_is_not_known_disturbs_nothing(self) -> None:
        assert find_disturbed([Surroundings()] * 2) == [(), ()]

    def test_pressure_that_the_graph_makes_itself(self) -> None:
        own = Surroundings(pressure=0.4)
        assert find_disturbed([own] * 5) == [()] * 5

    def test_foreign_load_is_what_no_process_of_the_run_used(self, tmp_path: Path) -> None:
        run = Simulation(segments=[Played(30, FAST)]).write(tmp_path)
        (found,) = read_samples(run).iterations[30.0]
        assert foreign_cores(found) == pytest.approx(0.05, abs=1e-6)

    @pytest.mark.parametrize(
        ("first", "again", "outcome"),
        [
            ("fail", "pass", "inconclusive"),
            ("fail", "fail", "fail"),
            ("pass", "fail", "pass"),
            ("inconclusive", "pass", "inconclusive"),
        ],
    )
    def test_it_may_weaken_a_failure_and_nothing_else(
        self, tmp_path: Path, first: str, again: str, outcome: Outcome
    ) -> None:
        segments = [Played(30, LATENCIES[first])] * 2 + [Played(30, LATENCIES[again])] * 2
        samples = read_samples(Simulation(segments=segments).write(tmp_path))
        names = [one.segment.id for one in samples.iterations[30.0]]
        disturbed = {
            names[0]: Disturbed(("2 % of the processor time was stolen",), rerun=names[2]),
            names[1]: Disturbed(("2 % of the processor time was stolen",), rerun=names[3]),
        }
        found = judge({"slo": objective(ASKED)}, samples, Terms(disturbed=disturbed))
        assert found.outcome == outcome
        assert "stolen" in found.requirements[0].notes[0]

    def test_a_rerun_that_is_disturbed_too_does_not_count(self, tmp_path: Path) -> None:
        segments = [Played(30, SLOW)] * 2
        samples = read_samples(Simulation(segments=segments).write(tmp_path))
        first, again = (one.segment.id for one in samples.iterations[30.0])
        reasons = ("processors were throttled for 1 s",)
        disturbed = {first: Disturbed(reasons, rerun=again), again: Disturbed(reasons)}
        found = judge({"slo": objective(ASKED)}, samples, Terms(disturbed=disturbed))
        assert found.outcome == "inconclusive"


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
        policy: Policy,
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
        from r2bspec.spec.quantities import Share

        run = Simulation(segments=[Played(30, FAST)]).write(tmp_path)
        sure = msgspec.structs.replace(objective(ASKED), confidence=Share(0.99))
        found = judge({"slo": sure}, read_samples(run)).requirements[0]
        assert (found.outcome, found.confidence) == ("inconclusive", 0.99)
