"""Playing iterations look by look, and disturbed ones again; what they measure is not examined."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from types import SimpleNamespace
from typing import Any, cast

import msgspec
import pytest

from r2bspec.execute.measurement.measurement import Measurement
from r2bspec.execute.run_context import TimeBudget
from r2bspec.execute.start.segments import SegmentHeading
from r2bspec.judge.verdict import (
    EXIT_CODES,
    DisturbedIteration,
    Outcome,
    RequirementVerdict,
    Verdict,
)
from r2bspec.plan.plan import GatePlan, Plan, PlayPlan
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


UNKNOWN: Any = dict.fromkeys(
    ("estimate", "lower", "upper", "limit", "over", "share", "rule_of_three")
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
        **UNKNOWN,
        unit="s",
        n=1,
        confidence=0.95,
        lost=False,
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


class Run:
    """A measurement that is told one verdict after the other.

    Attributes:
        starts: what was played in each start.
        confirming: how many of them confirm a failure.
        budget: of the run.
    """

    def __init__(self, verdicts: Sequence[Verdict], plan: Plan = PLAN, budget_ns: int = 0) -> None:
        self.starts: list[Played] = []
        self.confirming = 0
        self.budget = TimeBudget(budget_ns, lambda _: None)
        self._verdicts = iter(verdicts)
        context = SimpleNamespace(
            budget=self.budget,
            host=SimpleNamespace(between=None),
            note=lambda _: None,
            states=SimpleNamespace(enter=lambda *_: None),
        )
        starts = SimpleNamespace(begin=self._begin, find_foreign_publishers=lambda: False)
        self.measurement = Measurement(
            plan, cast("Any", context), cast("Any", starts), lambda _: next(self._verdicts)
        )

    def _begin(self, *, confirms: bool) -> Any:
        self.starts.append(Played())
        self.confirming += confirms
        return self.starts[-1]

    def measure(self) -> Run:
        """Play until it is decided; every verdict is asked for: none is reached without a look."""
        self.measurement.measure()
        assert next(self._verdicts, None) is None
        return self

    def played(self) -> list[list[str]]:
        """The names of what was played in each start."""
        return [
            [segment.id.removeprefix("rate-30Hz-") for segment in start.segments]
            for start in self.starts
        ]


def iterate(verdicts: Sequence[Verdict], budget_ns: int = 0) -> tuple[list[str], TimeBudget]:
    """The names of what was played in one start."""
    run = Run(verdicts, budget_ns=budget_ns).measure()
    (played,) = run.played()
    return played, run.budget


FIRST_LOOK = ["001", "002"]


def test_what_is_decided_is_not_played_again_however_disturbed() -> None:
    assert iterate([found("pass", busy(1), busy(2))])[0] == FIRST_LOOK


@pytest.mark.parametrize("confirmed", ["pass", "fail"])
def test_a_failure_is_confirmed_in_a_new_start_by_as_many_iterations(confirmed: Outcome) -> None:
    run = Run([found("fail", busy(1)), found(confirmed, busy(2))]).measure()
    assert run.played() == [FIRST_LOOK, FIRST_LOOK]
    assert run.confirming == 1


def test_what_a_failure_hangs_on_is_played_again_once() -> None:
    hanging = found("inconclusive", busy(1), weakened=True)
    again = busy(1, rerun="rate-30Hz-001-again")
    assert iterate([hanging, found("inconclusive", again)])[0] == [*FIRST_LOOK, "001-again"]
    # While the run goes on, nothing is played again: what comes next may be calm.
    open_ = found("inconclusive", busy(1))
    hanging = found("inconclusive", busy(1), busy(4), weakened=True)
    half = found("inconclusive", again, busy(4), weakened=True)
    done = found("inconclusive", again, busy(4, rerun="x"), weakened=True)
    played, _ = iterate([open_, hanging, half, done])
    assert played == [*FIRST_LOOK, "003", "004", "001-again", "004-again"]


def test_the_budget_comes_first() -> None:
    hanging = found("inconclusive", busy(1), busy(2), weakened=True)
    played, budget = iterate([hanging], budget_ns=1)
    assert played == FIRST_LOOK
    (rerun,) = budget.left_out
    assert rerun.startswith(
        "No rerun of rate-30Hz-001, which host interference affected: "
        "it would exceed the time budget"
    )
    played, budget = iterate([found("inconclusive")], budget_ns=1)
    assert played == FIRST_LOOK
    (look,) = budget.left_out
    assert look.startswith("No more than 2 iterations: it would exceed the time budget")


def plan_of(iterations: int, starts: int, max_iterations: int = 0) -> Plan:
    play = PlayPlan(
        rate_hz=30.0, duration_ns=1, iterations=iterations, max_iterations=max_iterations
    )
    return msgspec.structs.replace(PLAN, play=(play,), starts=starts)


@pytest.mark.parametrize(
    ("plan", "verdicts", "played"),
    [
        (plan_of(5, 2), "pass", "001 002 003, 004 005"),
        # Further iterations are further starts.
        (plan_of(4, 2, 16), "inconclusive pass", "001 002, 003 004, 005 006"),
        (plan_of(6, 6), "pass", "001, 002, 003"),
        (plan_of(6, 6), " ".join(["inconclusive"] * 4), "001, 002, 003, 004, 005, 006"),
        (plan_of(2, 1, 4), "inconclusive pass", "001 002 003 004"),
    ],
    ids=["a part in each", "further starts", "fewer", "all", "one start remains one"],
)
def test_each_start_plays_its_part(plan: Plan, verdicts: str, played: str) -> None:
    looks = [found(cast("Outcome", outcome)) for outcome in verdicts.split()]
    assert ", ".join(map(" ".join, Run(looks, plan).measure().played())) == played


def test_a_confirmation_plays_as_many_starts_as_decide_it() -> None:
    looks = [found("inconclusive"), found("fail"), found("inconclusive"), found("fail")]
    run = Run(looks, plan_of(4, 2, 16)).measure()
    assert [len(start) for start in run.played()] == [2] * 6
    assert run.confirming == 3
