"""The deployments in the race of a search: what their further starts show.

What the trials saw of them does not count: it chose them.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import islice
from typing import Final

from r2bspec.judge.measure.units import show
from r2bspec.judge.statistics.t_interval import mean_interval, paired_ratio
from r2bspec.language.benchmark_defaults import CONFIDENCE
from r2bspec.plan.tuning_space import Deployment
from r2bspec.tune.machine import Measurement
from r2bspec.tune.tuning_result import MAX_EXCESS, RequirementMargin, Trial

FIRST_DROP: Final = 3
"""Rounds after which a finalist may be left out: fewer have no deviation to speak of."""

_NEAR_LIMIT: Final = 0.1
"""A trial whose single start misses a limit by less than a tenth may keep it in the mean."""


@dataclass
class Finalist:
    """A deployment in the race.

    Attributes:
        trial: in which it was first seen; its values count only where there was no race.
        costs: of its starts in the race, by round.
        excesses: over the limit that it missed most, likewise.
        margins: of all requirements in the start in which it missed one most.
    """

    trial: Trial
    costs: list[float] = field(default_factory=list)
    excesses: list[float] = field(default_factory=list)
    margins: tuple[RequirementMargin, ...] = ()

    @property
    def deployment(self) -> Deployment:
        """That was tried."""
        return self.trial.deployment

    def add(self, seen: Measurement) -> None:
        """One more start."""
        excess = excess_of(seen)
        if excess >= max(self.excesses, default=-math.inf):
            self.margins = seen.margins
        self.excesses.append(excess)
        self.costs.append(math.inf if seen.cost is None else seen.cost)

    @property
    def order(self) -> tuple[float, float]:
        """Whoever misses a limit comes last; then whoever costs more."""
        excess = _mean(self.excesses) if self.excesses else self.trial.excess
        cost = _mean(self.costs) if self.costs else self.trial.cost
        return max(0.0, excess), math.inf if cost is None else cost

    @property
    def missed(self) -> str:
        """The requirement that it missed most, with how far it was missed."""
        margins = self.margins or self.trial.margins
        if not margins:
            return "them: it does not start every time"
        worst = max(margins, key=lambda margin: margin.excess)
        if worst.estimate is None or worst.excess >= MAX_EXCESS:
            return f"{worst.text} ({show(worst.estimate, worst.unit)})"
        return f"{worst.text} by {100 * math.expm1(worst.excess):.3g} %"


def finalists_of(trials: Sequence[Trial], most: int) -> list[Finalist]:
    """The trials that keep the limits, or nearly: those that keep them first, then the cheapest."""
    near = [trial for trial in trials if trial.cost is not None and trial.excess < _NEAR_LIMIT]
    near.sort(key=lambda trial: (trial.excess > 0, trial.cost))
    different: dict[Deployment, Trial] = {}
    for trial in near:
        different.setdefault(trial.deployment, trial)
    return [Finalist(trial) for trial in islice(different.values(), most)]


def is_worse(finalist: Finalist, best: Finalist) -> bool:
    """Whether the rounds so far show that a finalist is worse than the best one."""
    if finalist is best:
        return False
    if not all(map(math.isfinite, (*finalist.costs, *finalist.excesses))):
        return True
    if len(finalist.costs) < FIRST_DROP:
        return False
    if mean_interval(finalist.excesses, CONFIDENCE).lower > 0 >= best.order[0]:
        return True
    if not all(cost > 0 for cost in (*finalist.costs, *best.costs)):
        return False
    return paired_ratio(best.costs, finalist.costs, CONFIDENCE).lower > 1


def excess_of(seen: Measurement) -> float:
    """By how much a start misses the requirement that it misses most; at most 0 if it meets all."""
    if seen.state != "played":
        return math.inf
    return max((margin.excess for margin in seen.margins), default=0.0)


def _mean(values: Sequence[float]) -> float:
    return math.fsum(values) / len(values) if values else 0.0
