"""What a search needs of a machine on which deployments are tried, and what it gets from it."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Literal, NamedTuple, Protocol

import msgspec

from r2bspec.check.rules.tune_settings import goal_problem
from r2bspec.errors import UsageError
from r2bspec.judge.measure.metric_catalogue import Subjects, resolve
from r2bspec.judge.verdict import RequirementVerdict
from r2bspec.language.comparison_grammar import Requirement
from r2bspec.language.quantities import Rate
from r2bspec.language.spec import Objective
from r2bspec.plan.plan import Plan
from r2bspec.plan.tuning_space import Deployment
from r2bspec.tune.tuning_result import MAX_EXCESS, Gain, RequirementMargin


class TuningError(UsageError):
    """The spec or its objectives leave nothing to search for."""

    code = "R2B808"


class Goal(msgspec.Struct, frozen=True, kw_only=True):
    """The metric that is to be least, at the highest rate that an objective demands.

    Attributes:
        metric: as a requirement names it.
        at: the rate; None where the graph or the recording has its own.
        unit: of the metric.
    """

    metric: str
    at: Rate | None
    unit: str

    @property
    def text(self) -> str:
        """The metric with its rate."""
        return f"{self.metric} at {self.at}" if self.at is not None else self.metric


def goal_of(plan: Plan, metric: str) -> Goal:
    """The goal of a search: a metric at the highest rate that an objective of the plan demands.

    Raises:
        TuningError: there is no such metric, it cannot be minimized, it belongs to no single
            monitor, or nothing is played at a rate of which it could be measured.
    """
    monitors = [monitor.name for monitor in plan.monitors]
    subjects = Subjects.of_plan(plan)
    problem = goal_problem(metric, monitors, subjects, is_observed=bool(plan.anatomy))
    if problem is not None:
        message, way_out = problem
        end = "" if way_out.endswith("?") else "."
        raise TuningError(
            f"{metric} cannot be minimized: {message}",
            hint=f"{way_out[0].upper()}{way_out[1:]}{end}",
        )
    _, info = resolve(metric, monitors, subjects)
    if plan.playback_mode in {"timeline", "live"}:
        return Goal(metric=metric, at=None, unit=info.unit)
    played = {play.rate_hz for play in plan.play}
    rates = {
        objective.at
        for objective in plan.objectives.values()
        if objective.level == "error" and objective.at is not None and objective.at.hz in played
    }
    if not rates:
        rates = {Rate(hz) for hz in played}
    if not rates:
        raise TuningError(
            "no rate is played at which deployments could be compared",
            hint="Add benchmark.rates: the rate that the graph has to sustain.",
        )
    return Goal(metric=metric, at=max(rates), unit=info.unit)


class Measurement(msgspec.Struct, frozen=True, kw_only=True):
    """One start of a deployment; the fields are those of `Trial`."""

    state: Literal["played", "broken", "refused", "invalid"]
    cost: float | None = None
    margins: tuple[RequirementMargin, ...] = ()
    reason: str = ""
    run: str = ""


def margins_of(
    requirements: Sequence[RequirementVerdict], objectives: Mapping[str, Objective]
) -> tuple[RequirementMargin, ...]:
    """How far each requirement that counts is from its limit; those of a baseline are left out."""
    written = {
        (name, requirement.text): requirement
        for name, objective in objectives.items()
        for requirement in objective.require
    }
    several = len({one.at_hz for one in requirements}) > 1
    times = Counter((one.text, one.at_hz) for one in requirements)
    found = []
    for one in requirements:
        requirement = written.get((one.objective, one.text))
        if one.level != "error" or requirement is None or requirement.of_baseline:
            continue
        text = f"{one.text} at {one.at_hz:g} Hz" if several and one.at_hz else one.text
        if one.monitor and times[one.text, one.at_hz] > 1:
            text = f"{one.monitor}.{text}"
        found.append(
            RequirementMargin(
                text=text,
                outcome=one.outcome,
                estimate=one.estimate,
                limit=one.limit,
                unit=one.unit,
                excess=_excess(one, requirement),
            )
        )
    return tuple(found)


def _excess(one: RequirementVerdict, requirement: Requirement) -> float:
    """By how much a requirement is missed; see `RequirementMargin`."""
    missed = MAX_EXCESS if one.outcome == "fail" else 0.0
    if one.lost:
        return MAX_EXCESS
    if one.estimate is None or one.limit is None or requirement.op in {None, "==", "!="}:
        return missed
    over = (one.estimate, one.limit)
    above, below = over if requirement.op in {"<", "<="} else over[::-1]
    if above <= 0 < below:
        return -MAX_EXCESS
    if below <= 0:
        # No ratio to nothing: of a share that must be 0 each percent counts as such.
        return min(MAX_EXCESS, max(0.0, above - below))
    return max(-MAX_EXCESS, min(MAX_EXCESS, math.log(above / below)))


class Pairs(msgspec.Struct, frozen=True, kw_only=True):
    """Interleaved pairs of two deployments.

    Attributes:
        gain: of the head against the base.
        costs_more: whether they show that the head costs more.
        margins: of the requirements that the head's runs were judged by.
        reason: why nothing was judged; otherwise empty.
        no_ratio: why the gain alone has no value; otherwise empty.
        base_fails: whether nothing was judged because the base does not work.
        may_retry: whether nothing was judged by no fault of either: a host was lost, or the time.
    """

    gain: Gain
    costs_more: bool = False
    margins: tuple[RequirementMargin, ...] = ()
    reason: str = ""
    no_ratio: str = ""
    base_fails: bool = False
    may_retry: bool = False

    @property
    def head_meets(self) -> bool:
        """Whether the head's runs show that it keeps every limit."""
        return not self.reason and all(margin.outcome == "pass" for margin in self.margins)

    @property
    def head_may_fail(self) -> bool:
        """Whether they show that it breaks one, or measured more than one permits."""
        return any(margin.outcome == "fail" or margin.excess > 0 for margin in self.margins)


class Terms(msgspec.Struct, frozen=True, kw_only=True):
    """How a comparison is made.

    Attributes:
        limit_s: no further pair begins that would end later.
        error_share: of the chance of a wrong verdict that the spec permits.
        lever: the one in which the two sides differ; empty where they differ in several.
    """

    limit_s: float
    error_share: float = 1.0
    lever: str = ""


class Start(NamedTuple):
    """A deployment to be started.

    Attributes:
        name: of its run folder.
        round: starts of one round above 0 are compared with each other, so one host makes them.
    """

    deployment: Deployment
    name: str
    round: int = 0


class Machine(Protocol):
    """Where deployments are tried."""

    def now(self) -> float:
        """Seconds since any moment."""

    @property
    def width(self) -> int:
        """How many deployments are measured at once."""

    def measure(self, starts: Sequence[Start]) -> list[Measurement]:
        """Start deployments once each, and measure them."""

    def slowest_part(self, deployment: Deployment, name: str) -> str:
        """Start a deployment once, and say what takes most of its latency; empty if unknown."""

    def compare(
        self, base: Deployment, head: Deployment, pairs: int, name: str, terms: Terms
    ) -> Pairs:
        """Play two deployments in interleaved pairs of starts, at most so many.

        Args:
            base: to compare with.
            head: to be judged.
            pairs: the most that are played; fewer where they decide.
            name: of the folder.
            terms: of the comparison.
        """

    def judge(self, deployment: Deployment, name: str, terms: Terms) -> Pairs:
        """Play a deployment alone, as often as its spec says, where there is nothing to compare."""
