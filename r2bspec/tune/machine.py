"""What a search needs of a machine on which deployments are tried, and what it gets from it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal, NamedTuple, Protocol

import msgspec

from r2bspec.judge.measure.metric_catalogue import MetricError, Subjects, resolve
from r2bspec.language.quantities import Rate
from r2bspec.plan.plan import Plan
from r2bspec.plan.tuning_space import Deployment
from r2bspec.tune.errors import TuningError
from r2bspec.tune.tuning_result import Gain, RequirementMargin


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
        TuningError: there is no such metric, it belongs to no single monitor, or nothing is played
            at a rate of which it could be measured.
    """
    monitors = [monitor.name for monitor in plan.monitors]
    try:
        monitor, info = resolve(metric, monitors, Subjects.of_plan(plan))
    except MetricError as error:
        raise TuningError(
            f"{metric} cannot be minimized: {error}", hint="'r2bspec metrics' lists all metrics."
        ) from error
    if info.scope == "monitor" and monitor is None:
        raise TuningError(
            f"{metric} is not of one monitor", hint=f"Name it: {monitors[0]}.{metric}, for example."
        )
    if plan.playback_mode in {"timeline", "live"}:
        return Goal(metric=metric, at=None, unit=info.unit)
    played = {play.rate_hz for play in plan.play}
    rates = {
        objective.at
        for objective in plan.objectives.values()
        if objective.level == "error" and objective.at is not None and objective.at.hz in played
    }
    if not rates:
        rates = {Rate.parse(f"{hz:g} Hz") for hz in played}
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


class Pairs(msgspec.Struct, frozen=True, kw_only=True):
    """Interleaved pairs of two deployments.

    Attributes:
        gain: of the head against the base.
        costs_more: whether they show that the head costs more.
        margins: of the requirements that the head's runs were judged by.
        reason: why nothing is known; otherwise empty.
    """

    gain: Gain
    costs_more: bool = False
    margins: tuple[RequirementMargin, ...] = ()
    reason: str = ""

    @property
    def head_meets(self) -> bool:
        """Whether the head's runs show that it keeps every limit."""
        return not self.reason and all(margin.outcome == "pass" for margin in self.margins)

    @property
    def head_fails(self) -> bool:
        """Whether they show that it breaks one."""
        return any(margin.outcome == "fail" for margin in self.margins)


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
        self, base: Deployment, head: Deployment, pairs: int, name: str, lever: str = ""
    ) -> Pairs:
        """Play two deployments in interleaved pairs of starts, at most so many.

        Args:
            base: to compare with.
            head: to be judged.
            pairs: the most that are played; fewer where they decide.
            name: of the folder.
            lever: the one in which the two differ; empty where they differ in several.
        """
