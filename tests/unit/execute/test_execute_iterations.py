"""Playing iterations look by look, and disturbed ones again; what they measure is not examined."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any, cast

import msgspec
import pytest

from r2bspec.execute.measurement.measurement import IterationRunner
from r2bspec.execute.measurement.segments import SegmentHeading
from r2bspec.execute.run_context import TimeBudget
from r2bspec.judge.verdict import (
    EXIT_CODES,
    DisturbedIteration,
    Outcome,
    RequirementVerdict,
    Verdict,
)
from r2bspec.plan.plan import GatePlan, PlayPlan
from r2bspec.record.run_record import Segment
from run_simulation import Simulation

PLAN = msgspec.structs.replace(
    Simulation().plan(),
    play=(PlayPlan(rate_hz=30.0, duration_ns=10**9, iterations=2, max_iterations=4),),
    gate=GatePlan(),
)


@dataclass
class Played:
    """A stage that only remembers what was played on it."""

    segments: list[Segment] = field(default_factory=list)

    def play_for(self, heading: SegmentHeading, rate_hz: float, duration_ns: int) -> None:
        self.segments.append(
            Segment(
                id=heading.id,
                kind=heading.kind,
                rate_hz=rate_hz,
                index=heading.index,
                steps=round(rate_hz * duration_ns / 1e9),
                began_ns=0,
                ended_ns=1,
                complete=True,
                rerun_of=heading.rerun_of,
            )
        )


def found(
    outcome: Outcome, *disturbed: DisturbedIteration, weakened: bool = False, at_hz: float = 30.0
) -> Verdict:
    one = RequirementVerdict(
        objective="slo",
        text="latency.p99 < 60 ms",
        at_hz=at_hz,
        metric="latency.p99",
        monitor="out",
        outcome=outcome,
        method="exact binomial",
        estimate=None,
        lower=None,
        upper=None,
        limit=None,
        unit="s",
        n=1,
        confidence=0.95,
        over=None,
        lost=False,
        share=None,
        rule_of_three=None,
        reason="",
        remedy="",
        weakened=weakened,
    )
    return Verdict(
        outcome=outcome,
        exit_code=EXIT_CODES[outcome],
        reason="",
        requirements=(one,),
        unusable=(),
        disturbed=disturbed,
    )


def busy(number: int, **known: Any) -> DisturbedIteration:
    return DisturbedIteration(
        segment=f"rate-30Hz-{number:03d}", rate_hz=30.0, reasons=("stolen",), **known
    )


def no_start() -> Any:
    pytest.fail("a run of one start has no other")


def iterate(verdicts: Sequence[Verdict], budget_ns: int = 0) -> tuple[list[str], TimeBudget]:
    """Play, told one verdict after the other; the names of what was played."""
    segment_player, notes = Played(), list[str]()
    said: Iterator[Verdict] = iter(verdicts)
    budget = TimeBudget(budget_ns, notes.append)
    budget.begin()
    IterationRunner(
        PLAN, cast("Any", segment_player), lambda: next(said), notes.append, budget, no_start
    ).play()
    # Every verdict was asked for: none is reached without a look.
    assert next(said, None) is None
    return [each.id.removeprefix("rate-30Hz-") for each in segment_player.segments], budget


FIRST_LOOK = ["001", "002"]


@pytest.mark.parametrize("outcome", ["pass", "fail"])
def test_what_is_decided_is_not_played_again_however_disturbed(outcome: Outcome) -> None:
    assert iterate([found(outcome, busy(1), busy(2))])[0] == FIRST_LOOK


def test_what_is_open_is_played_on() -> None:
    assert iterate([found("inconclusive"), found("pass")])[0] == [*FIRST_LOOK, "003", "004"]


def test_what_a_failure_hangs_on_is_played_again_once() -> None:
    hanging = found("inconclusive", busy(1), weakened=True)
    again = busy(1, rerun="rate-30Hz-001-again")
    assert iterate([hanging, found("fail", again)])[0] == [*FIRST_LOOK, "001-again"]
    # The rerun was disturbed, too; the next look has nothing new to play again but its own.
    open_ = found("inconclusive", again, busy(4), weakened=True)
    done = found("inconclusive", again, busy(4, rerun="x"), weakened=True)
    played, _ = iterate([hanging, done, open_, done])
    assert played == [*FIRST_LOOK, "001-again", "003", "004", "004-again"]


def test_other_rates_are_left_alone() -> None:
    elsewhere = found("inconclusive", busy(1), weakened=True, at_hz=60.0)
    assert iterate([elsewhere, elsewhere])[0] == [*FIRST_LOOK, "003", "004"]


def test_the_budget_comes_first() -> None:
    hanging = found("inconclusive", busy(1), busy(2), weakened=True)
    played, budget = iterate([hanging], budget_ns=1)
    assert played == FIRST_LOOK
    rerun, look = budget.left_out
    assert rerun.startswith(
        "No rerun of rate-30Hz-001, which host interference affected: "
        "it would exceed the time budget"
    )
    assert look.startswith("No more than 2 iterations: it would exceed the time budget")


def start_after_start(
    iterations: int, starts: int, verdicts: Sequence[Verdict], max_iterations: int = 0
) -> tuple[list[list[str]], IterationRunner]:
    """Play in several starts; what was played in each."""
    stages = [Played()]

    def next_start() -> Any:
        stages.append(Played())
        return stages[-1]

    play = PlayPlan(
        rate_hz=30.0, duration_ns=1, iterations=iterations, max_iterations=max_iterations
    )
    said: Iterator[Verdict] = iter(verdicts)
    runner = IterationRunner(
        msgspec.structs.replace(PLAN, play=(play,), starts=starts),
        cast("Any", stages[0]),
        lambda: next(said),
        lambda _: None,
        TimeBudget(0, lambda _: None),
        next_start,
    )
    runner.play()
    assert next(said, None) is None
    return [[each.id.removeprefix("rate-30Hz-") for each in one.segments] for one in stages], runner


def test_each_start_plays_its_part() -> None:
    played, _ = start_after_start(5, 2, [found("pass")])
    assert played == [["001", "002", "003"], ["004", "005"]]


def test_further_iterations_are_further_starts() -> None:
    verdicts = [found("inconclusive"), found("pass")]
    played, _ = start_after_start(4, 2, verdicts, max_iterations=16)
    assert played == [["001", "002"], ["003", "004"], ["005", "006"], ["007", "008"]]


def test_one_start_remains_one_start() -> None:
    played, _ = start_after_start(2, 1, [found("inconclusive"), found("pass")], max_iterations=4)
    assert played == [["001", "002", "003", "004"]]


def test_an_iteration_of_an_earlier_start_is_played_again_in_the_one_that_runs() -> None:
    hanging = found("inconclusive", busy(1), weakened=True)
    done = found("fail", busy(1, rerun="rate-30Hz-001-again"))
    played, runner = start_after_start(4, 2, [hanging, done])
    assert played == [["001", "002"], ["003", "004", "001-again"]]
    assert runner.segment_player.segments[-1].index == 1


def test_a_confirmation_plays_in_as_many_starts() -> None:
    stages = [Played()]
    play = PlayPlan(rate_hz=30.0, duration_ns=1, iterations=4, max_iterations=16)

    def next_start() -> Any:
        stages.append(Played())
        return stages[-1]

    IterationRunner(
        msgspec.structs.replace(PLAN, play=(play,), starts=2),
        cast("Any", stages[0]),
        lambda: found("fail"),
        lambda _: None,
        TimeBudget(0, lambda _: None),
        next_start,
    ).play_fixed_number(8)
    assert [len(each.segments) for each in stages] == [2, 2, 2, 2]
