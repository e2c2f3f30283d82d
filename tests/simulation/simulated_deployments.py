"""Graphs whose every deployment has a known cost and latency, measured with noise.

A graph has five to seven levers. Two or three of them matter, some trade cost for latency, two
interact, and one setting breaks the graph. A start takes ten seconds, and scatters by `NOISE`.
"""

from __future__ import annotations

import contextlib
import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Final

import numpy as np

from r2bspec.judge.statistics.t_interval import paired_ratio
from r2bspec.plan.tuning_space import Deployment, Lever, Setting, TuningSpace
from r2bspec.tune.machine import Measurement, Pairs, Start, Terms
from r2bspec.tune.search import Search, SearchListener, SearchSettings
from r2bspec.tune.tuning_result import Gain, RequirementMargin, TuningResult

NOISE: Final = 0.04
"""Standard deviation of the logarithm of the cost of a start; that of its latency is the same."""

START_S: Final = 10.0
SETTINGS: Final = SearchSettings(trials=30, budget_s=1200.0, pairs=8)
LIMIT_S: Final = 0.050


def blank(space: TuningSpace) -> TuningResult:
    """The result of a search without a trial."""
    return TuningResult(
        name="simulated",
        title="",
        goal="cpu.graph.mean",
        goal_unit="share",
        outcome="incomplete",
        reason="",
        space=space,
        trials=(),
    )


@dataclass
class SimulatedGraph:
    """A graph, and the machine on which it is deployed.

    Attributes:
        space: of its deployments.
        cost: effects on the logarithm of the cost, by lever and setting.
        latency: likewise on that of the latency, relative to the limit.
        together: the further effect on the cost of two settings, where both are chosen.
        broken: a lever and a setting with which nothing works.
    """

    space: TuningSpace
    cost: dict[tuple[str, int], float]
    latency: dict[tuple[str, int], float]
    together: dict[tuple[tuple[str, int], tuple[str, int]], float]
    broken: tuple[str, int]
    today_excess: float
    chance: np.random.Generator
    noise: float = NOISE
    clock_s: float = 0.0
    starts: int = field(default=0)

    @classmethod
    def drawn(cls, seed: int, noise: float = NOISE) -> SimulatedGraph:
        """A graph by chance; today's deployment of every other one misses the limit."""
        chance = np.random.default_rng(seed)
        levers = tuple(
            Lever(
                name=f"lever_{number}",
                settings=tuple(
                    Setting(text=f"{place}", sets=(f"x{number}={place}",) if place else ())
                    for place in range(int(chance.integers(2, 5)))
                ),
            )
            for number in range(int(chance.integers(5, 8)))
        )
        keys = [(lever.name, place) for lever in levers for place in range(1, len(lever.settings))]
        strong = {keys[int(place)] for place in chance.choice(len(keys), 4, replace=False)}
        cost = {key: -chance.uniform(0.08, 0.3) if key in strong else 0.0 for key in keys}
        latency = {key: chance.uniform(-0.25, 0.1) if key in strong else 0.0 for key in keys}
        for place in chance.choice(len(keys), 2, replace=False):
            cost[keys[int(place)]] += chance.uniform(0.05, 0.3)
            latency[keys[int(place)]] -= chance.uniform(0.1, 0.4)
        one, other = (keys[int(place)] for place in chance.choice(len(keys), 2, replace=False))
        weak = [key for key in keys if key not in strong]
        return cls(
            space=TuningSpace(levers=levers),
            cost=cost,
            latency=latency,
            together={(one, other): chance.uniform(-0.15, 0.15)},
            broken=weak[int(chance.integers(len(weak)))],
            today_excess=0.1 if seed % 2 else -0.3,
            chance=chance,
            noise=noise,
        )

    def true_cost(self, deployment: Deployment) -> float:
        """The cost that no noise touches."""
        keys = {(choice.lever, choice.place) for choice in deployment.choices}
        both = sum(effect for pair, effect in self.together.items() if keys >= set(pair))
        return math.exp(sum(self.cost[key] for key in keys) + both)

    def true_excess(self, deployment: Deployment) -> float:
        """Over the limit; at most 0 where it is kept."""
        keys = [(choice.lever, choice.place) for choice in deployment.choices]
        return self.today_excess + sum(self.latency[key] for key in keys)

    def works(self, deployment: Deployment) -> bool:
        """Whether the graph starts at all."""
        return self.broken not in [(choice.lever, choice.place) for choice in deployment.choices]

    def deployments(self) -> Iterator[Deployment]:
        """All of them."""
        places = [range(len(lever.settings)) for lever in reversed(self.space.levers)]
        names = [lever.name for lever in reversed(self.space.levers)]
        for choice in itertools.product(*places):
            yield self.space.deployment(dict(zip(names, choice, strict=True)))

    def best_cost(self) -> float:
        """Of the deployments that work and keep the limit; infinite if there is none."""
        return min(
            (
                self.true_cost(deployment)
                for deployment in self.deployments()
                if self.works(deployment) and self.true_excess(deployment) <= 0
            ),
            default=math.inf,
        )

    def is_near(self, deployment: Deployment, best: float) -> bool:
        """Whether it works, keeps the limit, and costs less than 5 % more than the best."""
        keeps = self.works(deployment) and self.true_excess(deployment) <= 0
        return keeps and self.true_cost(deployment) < 1.05 * best

    # What the search sees.

    def now(self) -> float:
        """Seconds that the starts have taken."""
        return self.clock_s

    @property
    def width(self) -> int:
        """One host."""
        return 1

    def measure(self, starts: Sequence[Start]) -> list[Measurement]:
        """One start each."""
        return [self._start(start.deployment, start.name) for start in starts]

    def _start(self, deployment: Deployment, name: str) -> Measurement:
        self.clock_s += START_S
        self.starts += 1
        if not self.works(deployment):
            return Measurement(state="broken", reason="R2B640: not ready", run=name)
        excess = self.true_excess(deployment) + self._scatter()
        cost = self.true_cost(deployment) * math.exp(self._scatter())
        return Measurement(state="played", cost=cost, margins=(_margin(excess),), run=name)

    def slowest_part(self, deployment: Deployment, name: str) -> str:
        """What takes most of the latency."""
        del deployment, name
        return "first: callback takes 41 ms of 58 ms in the mean"

    def judge(self, deployment: Deployment, name: str, terms: Terms) -> Pairs:
        """Never asked for: today's deployment works."""
        raise NotImplementedError

    def compare(
        self, base: Deployment, head: Deployment, pairs: int, name: str, terms: Terms
    ) -> Pairs:
        """Interleaved pairs, judged once by all of them."""
        sides = [[self._start(side, name) for _ in range(pairs)] for side in (base, head)]
        costs = [[one.cost for one in side if one.cost is not None] for side in sides]
        known = all(len(values) == pairs for values in costs)
        found = paired_ratio(costs[0], costs[1], 1 - 0.05 * terms.error_share) if known else None
        gain = Gain(
            change=head.text,
            lever=terms.lever,
            metric="cpu.graph.mean",
            unit="share",
            before=None,
            after=None,
            ratio=found.ratio if found else None,
            lower=found.lower if found else None,
            upper=found.upper if found else None,
            pairs=pairs,
        )
        excesses = [one.margins[0].excess for one in sides[1] if one.margins]
        mean = sum(excesses) / len(excesses) if excesses else math.inf
        half = 2 * self.noise / math.sqrt(pairs)
        return Pairs(
            gain=gain,
            costs_more=found is not None and found.lower > 1,
            margins=(_margin(mean, half),),
            reason="" if found else "a side does not work",
        )

    def _scatter(self) -> float:
        return float(self.chance.normal(0.0, self.noise))


def _margin(excess: float, half: float = 0.0) -> RequirementMargin:
    undecided = abs(excess) < half
    return RequirementMargin(
        text="latency.p99 < 50 ms",
        outcome="inconclusive" if undecided else "pass" if excess <= 0 else "fail",
        estimate=LIMIT_S * math.exp(min(excess, 3.0)),
        limit=LIMIT_S,
        unit="s",
        excess=min(excess, 3.0),
    )


class _NearBestError(Exception):
    """A search has tried a deployment that is as good as the best."""


class _Watch(SearchListener):
    """Ends a search with the first trial that is as good as the best deployment."""

    def __init__(self, graph: SimulatedGraph, best: float) -> None:
        self._graph, self._best = graph, best
        self.trials = 0

    def found(self, result: TuningResult) -> None:
        self.trials = len(result.trials)
        if result.trials and self._graph.is_near(result.trials[-1].deployment, self._best):
            raise _NearBestError


def trials_needed(seed: int) -> dict[str, int]:
    """Trials until a deployment is tried that keeps the limit and costs 5 % more than the best.

    Of the search, of chance, and of a grid: every combination in the order of the levers, the first
    one varying fastest. None where no deployment keeps the limit.
    """
    graph = SimulatedGraph.drawn(seed)
    best = graph.best_cost()
    if math.isinf(best):
        return {}
    watch = _Watch(graph, best)
    settings = SearchSettings(trials=10_000, budget_s=1e7, pairs=8, seed=seed)
    with contextlib.suppress(_NearBestError):
        Search(blank(graph.space), graph, settings, listener=watch).run()
    grid = list(graph.deployments())
    near = np.array([graph.is_near(each, best) for each in grid])
    order = np.random.default_rng(seed).permutation(len(grid))
    return {
        "search": watch.trials,
        "chance": int(near[order].argmax()) + 1,
        "grid": int(near.argmax()) + 1,
    }
