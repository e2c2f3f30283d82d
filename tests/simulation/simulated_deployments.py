"""Specs whose every combination of values has a known cost and latency, measured with noise.

Five to seven keys have one to three values to try. Four of these values matter, two trade cost for
latency, two interact, and one breaks the graph. A start takes ten seconds.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from r2bspec.judge.statistics.t_interval import paired_ratio
from r2bspec.tune.search import SearchLimits
from r2bspec.tune.space import MAX_EXCESS, Combination, Space
from r2bspec.tune.tuning_result import Proof, Start, StartOutcome

NOISE: Final = 0.04
"""Standard deviation of the logarithm of the cost of a start; that of its latency is the same."""

START_S: Final = 10.0
LIMITS: Final = SearchLimits(trials=30, budget_s=1200.0, pairs=8)

Key = tuple[int, int]
"""A path and the place of one of its values."""


@dataclass
class SimulatedGraph:
    """A graph, and the machine on which it is started.

    Attributes:
        space: of its combinations.
        cost: effects on the logarithm of the cost.
        latency: likewise on that of the latency, relative to the limit.
        together: the further effect on the cost of two values, where both are chosen.
        broken: a value with which nothing works; None if there is none.
    """

    space: Space
    cost: dict[Key, float]
    latency: dict[Key, float]
    together: tuple[Key, Key, float]
    broken: Key | None
    today_excess: float
    chance: np.random.Generator
    noise: float = NOISE
    clock_s: float = 0.0

    @classmethod
    def drawn(cls, seed: int) -> SimulatedGraph:
        """A graph by chance; today's values of every other one miss the limit."""
        chance = np.random.default_rng(seed)
        space = Space(
            {
                f"graph.x{number}": tuple(range(int(chance.integers(1, 4))))
                for number in range(int(chance.integers(5, 8)))
            }
        )
        keys = [(path, place) for path, size in enumerate(space.sizes) for place in range(1, size)]

        def some(count: int) -> list[Key]:
            return [keys[int(place)] for place in chance.choice(len(keys), count, replace=False)]

        strong = some(4)
        cost = {key: -chance.uniform(0.08, 0.3) if key in strong else 0.0 for key in keys}
        latency = {key: chance.uniform(-0.25, 0.1) if key in strong else 0.0 for key in keys}
        for key in some(2):
            cost[key] += chance.uniform(0.05, 0.3)
            latency[key] -= chance.uniform(0.1, 0.4)
        first, second = some(2)
        weak = [key for key in keys if key not in strong]
        return cls(
            space=space,
            cost=cost,
            latency=latency,
            together=(first, second, chance.uniform(-0.15, 0.15)),
            broken=weak[int(chance.integers(len(weak)))] if weak else None,
            today_excess=0.1 if seed % 2 else -0.3,
            chance=chance,
        )

    @classmethod
    def without_effects(cls, seed: int) -> SimulatedGraph:
        """A graph whose values change nothing, and whose starts differ by 10 %."""
        graph = cls.drawn(2 * seed)
        graph.cost = dict.fromkeys(graph.cost, 0.0)
        graph.latency = dict.fromkeys(graph.latency, 0.0)
        graph.together, graph.broken, graph.noise = ((0, 1), (0, 1), 0.0), None, 0.1
        return graph

    def true_cost(self, combination: Combination) -> float:
        """The cost without noise."""
        keys = _keys(combination)
        first, second, both = self.together
        further = both if first in keys and second in keys else 0.0
        return math.exp(sum(self.cost[key] for key in keys) + further)

    def true_excess(self, combination: Combination) -> float:
        """Over the limit; at most 0 where it is kept."""
        return self.today_excess + sum(self.latency[key] for key in _keys(combination))

    def keeps(self, combination: Combination) -> bool:
        """Whether a combination works and keeps the limit."""
        return self.broken not in _keys(combination) and self.true_excess(combination) <= 0

    def best_cost(self) -> float:
        """Of the combinations that work and keep the limit; infinite if there is none."""
        combinations = itertools.product(*map(range, self.space.sizes))
        return min(
            (self.true_cost(one) for one in combinations if self.keeps(one)), default=math.inf
        )

    # What the search sees; see `r2bspec.tune.search.Machine`.

    def now(self) -> float:
        """Seconds that the starts have taken."""
        return self.clock_s

    def start(self, combination: Combination, name: str) -> Start:
        """One start."""
        self.clock_s += START_S
        if self.broken in _keys(combination):
            return Start(outcome="broken", excess=MAX_EXCESS, reason="R2B640: not ready")
        excess = self.true_excess(combination) + self._scatter()
        # The messages of one start show what is far from the limit.
        outcome: StartOutcome = (
            "inconclusive" if abs(excess) < 0.05 else "pass" if excess < 0 else "fail"
        )
        return Start(
            outcome=outcome,
            cost=self.true_cost(combination) * math.exp(self._scatter()),
            excess=excess,
            reason="latency.p99 < 50 ms" if excess > 0 else "",
            run=name,
        )

    def prove(
        self,
        base: Combination | None,
        winner: Combination,
        pairs: int,
        limit_s: float,  # noqa: ARG002
    ) -> Proof:
        """Interleaved pairs, judged once by all of them."""
        assert base is not None, "today's values work"
        before, after = (
            [self.start(side, "proof") for _ in range(pairs)] for side in (base, winner)
        )
        costs = [[start.cost for start in side if start.cost] for side in (before, after)]
        if len(costs[0]) < pairs or len(costs[1]) < pairs:
            return Proof(run="proof", reason="a side does not work")
        found = paired_ratio(costs[0], costs[1], 0.95)
        mean = sum(start.excess for start in after) / pairs
        return Proof(
            run="proof",
            meets=mean < -2 * self.noise / math.sqrt(pairs),
            gains=found.upper < 1,
            ratio=found.ratio,
            pairs=pairs,
        )

    def _scatter(self) -> float:
        return float(self.chance.normal(0.0, self.noise))


def _keys(combination: Combination) -> list[Key]:
    return [(path, place) for path, place in enumerate(combination) if place]
