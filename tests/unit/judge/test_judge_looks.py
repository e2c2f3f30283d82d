"""Looks: when they are, what they may be wrong in, and what follows from one."""

from __future__ import annotations

import msgspec
import numpy as np
import pytest

from nightly import sampled
from r2bspec.judge.decision_policy import DecisionPolicy, combine_looks, decide_after_look
from r2bspec.judge.measure.metric_catalogue import find_metric
from r2bspec.judge.measure.samples import RunSamples
from r2bspec.judge.methods import Method
from r2bspec.judge.pipeline import judge
from r2bspec.judge.requirement_case import Decision, RequirementCase, requirement_verdict
from r2bspec.judge.verdict import Outcome, RequirementVerdict
from r2bspec.language.comparison_grammar import parse_requirement
from r2bspec.plan.interim_looks import MAX_LOOKS, InterimLooks
from r2bspec.plan.plan import PlayPlan
from run_simulation import Played, Simulation, objective
from simulated_runs import run_of


def verdict_of(outcome: Outcome, method: Method = "exact binomial") -> RequirementVerdict:
    requirement, info = parse_requirement("latency.p99 < 60 ms"), find_metric("latency.p99")
    case = RequirementCase("slo", requirement, 30.0, info, "out", 0.06)
    return requirement_verdict(case, Decision(outcome=outcome, method=method, reason="Because."))


class TestThePlan:
    def test_one_start_has_them_at_one_two_and_four_times(self) -> None:
        assert InterimLooks.planned(5, most=20).iterations == (5, 10, 20)
        assert InterimLooks.planned(5, most=12).iterations == (5, 10, 12)
        assert InterimLooks.planned(5, most=30).iterations == (5, 10, 20, 30)
        assert InterimLooks.planned(5, most=3).iterations == (5,)

    def test_several_starts_have_them_after_each_from_the_third_on(self) -> None:
        assert InterimLooks.planned(14, 7).iterations == (6, 8, 10, 12, 14)
        assert InterimLooks.planned(10, 5).iterations == (6, 8, 10)
        assert InterimLooks.planned(7, 3).iterations == (7,)
        assert InterimLooks.planned(4, 2, 12).iterations == (4, 6, 8, 10, 12)
        many = InterimLooks.planned(2000, 1000)
        assert len(many) <= MAX_LOOKS
        assert many.iterations[-1] == 2000

    def test_a_run_that_is_judged_once_has_none(self) -> None:
        play = PlayPlan(rate_hz=30.0, duration_ns=1, iterations=4)
        assert InterimLooks.of_plays((), 5) is None
        assert InterimLooks.of_plays((play,), 1) is None
        assert InterimLooks.of_plays((play,), 2) is None
        looks = InterimLooks.of_plays((play, msgspec.structs.replace(play, iterations=12)), 6)
        assert looks is not None
        assert (looks.iterations, looks.declared) == ((6, 8, 10, 12), 12)

    @pytest.mark.parametrize("iterations", [(5,), (5, 10, 20), (3, 7, 50)])
    def test_the_error_is_divided_without_a_rest(self, iterations: tuple[int, ...]) -> None:
        looks = InterimLooks(iterations)
        errors = [1 - looks.confidence_at(look) for look in range(1, len(looks) + 1)]
        assert sum(errors) == pytest.approx(0.05)
        assert InterimLooks((5,)).confidence_at(1, 0.9) == pytest.approx(0.9)


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
        assert (
            decide_after_look(self.LOOKS, look, [verdict_of(outcome) for outcome in outcomes])
            == step
        )

    def test_what_more_iterations_cannot_settle_is_not_played_for(self) -> None:
        open_ = verdict_of("inconclusive", "sequential probe")
        assert decide_after_look(self.LOOKS, 1, [open_]) == "inconclusive"
        opened = msgspec.structs.replace(verdict_of("inconclusive"), weakened=True)
        assert decide_after_look(self.LOOKS, 1, [opened]) == "inconclusive"
        # Bounds that leave out the limit: something else is missing than iterations.
        bounds = msgspec.structs.replace(verdict_of("inconclusive"), lower=0.01, upper=0.02)
        assert decide_after_look(self.LOOKS, 1, [bounds]) == "inconclusive"
        around = msgspec.structs.replace(bounds, upper=0.07)
        assert decide_after_look(self.LOOKS, 1, [around]) == "go on"

    @pytest.mark.parametrize(
        ("requirements", "step"),
        [
            ([verdict_of("pass")], "pass"),
            ([verdict_of("pass"), verdict_of("fail", "observation")], "fail"),
            ([verdict_of("pass"), verdict_of("pass", "observation")], "go on"),
            ([verdict_of("pass"), verdict_of("inconclusive", "search bracket")], "pass"),
            ([verdict_of("pass", "sequential probe")], "go on"),
            ([verdict_of("inconclusive", "none")], "go on"),
            ([], "go on"),
        ],
    )
    def test_before_the_declared_iterations_only_a_test_ends_the_run(
        self, requirements: list[RequirementVerdict], step: str
    ) -> None:
        looks = InterimLooks.planned(14, 7)
        assert decide_after_look(looks, 2, requirements) == step


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
        found = combine_looks(self.LOOKS, [verdict_of(outcome) for outcome in outcomes])
        assert (found.outcome, found.look, found.looks) == (together, look, 3)


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

    @pytest.mark.parametrize(
        ("text", "met"),
        sampled(
            [
                # 20 ms, and starts that differ by 1 %: another kind of start could be at 23 ms.
                ("latency.mean < 25 ms", "room"),
                ("latency.mean > 16 ms", "room"),
                ("latency.mean < 21.5 ms", "starts do not rule out"),
                ("latency.mean < 19 ms", "starts do not rule out"),
                ("latency.mean < 15 ms", "room"),
                ("latency.p50 < 25 ms", "room"),
                ("latency.p50 < 15 ms", "room"),
                ("latency.p99 < 30 ms", "bursts of 20"),
                ("drop_rate <= 2 %", "bursts of 20"),
                ("drop_rate <= 18 %", "room"),
                ("drop_rate <= 7.5 %", "starts do not rule out"),
            ],
            2,
            1,
        ),
    )
    def test_a_decision_waits_for_the_declared_starts_without_room_for_what_they_may_meet(
        self, text: str, met: str
    ) -> None:
        random, looks = np.random.default_rng(2), InterimLooks.planned(14, 7)
        levels = np.repeat(0.02 * (1 + 0.01 * random.standard_normal(7)), 2)
        latency = levels[:, None] * (1 + 0.02 * random.standard_normal((14, 300)))
        starts = np.repeat(np.arange(1, 8), 2).tolist()
        outcome = "fail" if text.endswith(("< 19 ms", "< 15 ms")) else "pass"
        for look, end in enumerate(looks.iterations, start=1):
            samples = run_of(latency[:end], starts[:end])
            found = judge({"slo": objective(text)}, samples, DecisionPolicy(looks=looks))
            (one,) = found.requirements
            early = met != "room" and end < looks.declared
            # A FAIL of fewer than five starts is none without room.
            assert one.outcome == ("inconclusive" if early and look < 3 else outcome) or (
                outcome == "pass" and one.outcome == "pass"
            )
            assert one.early == early
            assert any(met in note for note in one.notes) == early
            assert decide_after_look(looks, look, [one]) == ("go on" if early else outcome)
        # A FAIL is that of the last look.
        assert one.look == (1 if met == "room" and outcome == "pass" else len(looks))
