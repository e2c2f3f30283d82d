"""Looks: when they are, what they may be wrong in, and what follows from one."""

from __future__ import annotations

import msgspec
import numpy as np
import pytest

from r2bspec.judge.decision_policy import (
    DecisionPolicy,
    InterimLooks,
    combine_looks,
    decide_after_look,
    decision_policy,
)
from r2bspec.judge.measure.metric_catalogue import METRICS
from r2bspec.judge.measure.samples import RunSamples
from r2bspec.judge.methods import Method
from r2bspec.judge.pipeline import judge
from r2bspec.judge.requirement_case import Decision, RequirementCase, requirement_verdict
from r2bspec.judge.verdict import Outcome, RequirementVerdict
from r2bspec.language.requirement_grammar import parse_requirement
from run_simulation import Played, Simulation, objective


def verdict_of(outcome: Outcome, method: Method = "exact binomial") -> RequirementVerdict:
    requirement, info = parse_requirement("latency.p99 < 60 ms"), METRICS["latency.p99"]
    case = RequirementCase("slo", requirement, 30.0, info, "out", 0.06)
    return requirement_verdict(case, Decision(outcome=outcome, method=method, reason="Because."))


class TestThePlan:
    def test_one_two_and_four_times(self) -> None:
        assert InterimLooks.planned(5, 20).iterations == (5, 10, 20)
        assert InterimLooks.planned(5, 12).iterations == (5, 10, 12)
        assert InterimLooks.planned(5, 30).iterations == (5, 10, 20, 30)
        assert InterimLooks.planned(5, 3).iterations == (5,)

    @pytest.mark.parametrize("iterations", [(5,), (5, 10, 20), (3, 7, 50)])
    def test_the_error_is_divided_without_a_rest(self, iterations: tuple[int, ...]) -> None:
        looks = InterimLooks(iterations)
        errors = [1 - looks.confidence_at(look) for look in range(1, len(looks) + 1)]
        assert sum(errors) == pytest.approx(0.05)
        assert InterimLooks((5,)).confidence_at(1, 0.9) == pytest.approx(0.9)

    @pytest.mark.parametrize("iterations", [(), (0,), (5, 5), (5, 3)])
    def test_nonsense_is_refused(self, iterations: tuple[int, ...]) -> None:
        with pytest.raises(ValueError, match="ascending"):
            InterimLooks(iterations)

    def test_looks_that_a_run_has_reached(self) -> None:
        looks = InterimLooks((5, 10, 20))
        reached = {0: 0, 4: 0, 5: 1, 10: 2, 19: 2, 20: 3, 99: 3}
        assert {n: looks.completed_looks(n) for n in reached} == reached


class TestWhatToDoNext:
    LOOKS = InterimLooks((5, 10, 20))

    @pytest.mark.parametrize(
        ("outcomes", "look", "step"),
        [
            (("pass", "pass"), 1, "pass"),
            (("pass", "fail", "inconclusive"), 1, "fail"),
            (("pass", "inconclusive"), 1, "go on"),
            (("pass", "inconclusive"), 3, "inconclusive"),
            ((), 1, "pass"),
        ],
    )
    def test_steps(self, outcomes: tuple[Outcome, ...], look: int, step: str) -> None:
        assert decide_after_look(self.LOOKS, look, [verdict_of(one) for one in outcomes]) == step

    def test_what_more_iterations_cannot_settle_is_not_played_for(self) -> None:
        open_ = verdict_of("inconclusive", "sequential probe")
        assert decide_after_look(self.LOOKS, 1, [open_]) == "inconclusive"


class TestAllLooksTogether:
    LOOKS = InterimLooks((5, 10, 20))

    @pytest.mark.parametrize(
        ("outcomes", "together", "look"),
        [
            (("pass", "inconclusive"), "pass", 1),
            (("fail", "inconclusive"), "fail", 1),
            (("fail", "pass"), "fail", 1),
            (("pass", "fail"), "fail", 2),
            (("inconclusive", "pass", "inconclusive"), "pass", 2),
            (("inconclusive", "inconclusive"), "inconclusive", 2),
        ],
    )
    def test_the_first_decision_stands_unless_it_turns_out_a_failure(
        self, outcomes: tuple[Outcome, ...], together: str, look: int
    ) -> None:
        found = combine_looks(self.LOOKS, [verdict_of(one) for one in outcomes])
        assert (found.outcome, found.look, found.looks) == (together, look, 3)
        assert "look" in found.notes[0]

    def test_what_was_only_seen_follows_all_that_was_seen(self) -> None:
        seen = [verdict_of("pass", "observation"), verdict_of("inconclusive", "observation")]
        assert combine_looks(self.LOOKS, seen).outcome == "inconclusive"

    def test_the_next_look_is_named(self) -> None:
        found = combine_looks(self.LOOKS, [verdict_of("inconclusive")])
        assert "after 10 iterations" in found.remedy


class TestAWholeRun:
    @staticmethod
    def samples(iterations: int) -> RunSamples:
        random = np.random.default_rng(3)
        segments = [
            Played(30, np.where(random.random(100) < 0.04, 0.1, 0.02)) for _ in range(iterations)
        ]
        return Simulation(segments=segments).samples()

    def test_each_look_is_taken_from_the_iterations_that_it_had(self) -> None:
        policy = DecisionPolicy(looks=InterimLooks((3, 6, 12)))
        objectives = {"slo": objective("latency.p90 < 60 ms", "missed == 0")}
        samples = self.samples(12)
        found = judge(objectives, samples, policy)
        percentile, missed = found.requirements
        assert percentile.outcome == "pass"
        assert 1 <= percentile.look <= 3
        assert percentile.confidence == pytest.approx(policy.looks.confidence_at(percentile.look))  # type: ignore[union-attr]
        assert missed.outcome == "pass"
        # Judging again, from the whole run, takes the same looks again.
        assert msgspec.json.encode(judge(objectives, samples, policy)) == msgspec.json.encode(found)

    def test_a_plan_states_its_terms(self) -> None:
        plan = Simulation().plan()
        assert decision_policy(plan).looks is None
        assert decision_policy(plan).confidence == 0.95
