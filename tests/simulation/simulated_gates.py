"""How often gates pass and fail in simulated runs of known truth, by each of their methods.

A gate gives 1 for a pass, -1 for a fail and 0 for what stays open. Where nothing else is said the
truth is exactly on the limit, where a gate is wrong most often, and each batch is drawn anew.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from functools import partial

import numpy as np
from numpy.typing import NDArray
from scipy import signal

from r2bspec.judge.measure.times import rank
from r2bspec.judge.statistics.percentile_interval import level_margin
from r2bspec.judge.statistics.shares import ShareBounds, ShareLimit, bounds_of_flags
from r2bspec.judge.statistics.t_interval import (
    RatioInterval,
    pair_orders,
    paired_ratio,
    scatter_level,
)
from r2bspec.plan.interim_looks import InterimLooks, pairs_that_confirm

CONFIDENCE = 0.95
Values = NDArray[np.float64]


@dataclass
class Errors:
    """Counts of runs: passes, fails, and fails that were confirmed.

    Attributes:
        said: of the passes and fails, those that say what the run may not have met.
    """

    runs: int
    counts: NDArray[np.int64] = field(default_factory=lambda: np.zeros(3, dtype=np.int64))
    said: int = 0

    @classmethod
    def of(cls, outcomes: Iterable[int]) -> Errors:
        """Those of gates without a confirmation."""
        found = np.array([*outcomes])
        return cls(found.size, np.array([np.sum(found > 0), np.sum(found < 0), 0]))

    def add(self, outcome: int, confirm: Callable[[], int]) -> None:
        """Count an outcome, and that of the confirmation of a fail."""
        self.counts += (outcome > 0, outcome < 0, outcome < 0 and confirm() < 0)

    @property
    def shares(self) -> tuple[float, float, float]:
        passed, failed, confirmed = (self.counts / self.runs).tolist()
        return passed, failed, confirmed

    @property
    def passed(self) -> float:
        return self.shares[0]

    @property
    def failed(self) -> float:
        return self.shares[1]

    @property
    def rates(self) -> str:
        """Passes and fails in percent."""
        return f"{100 * self.passed:.1f} / {100 * self.failed:.1f}"

    def __str__(self) -> str:
        return f"{self.rates} / {100 * self.shares[2]:.1f}"


def chance(promise: float, runs: int) -> float:
    """What a promised share comes to in so many runs with bad luck: three standard errors more."""
    return promise + 3 * math.sqrt(promise * (1 - promise) / runs)


def held(found: Errors) -> bool:
    """Whether the three shares are what is promised, or more by chance."""
    most = chance(0.05, found.runs)
    return max(found.shares[:2]) <= most and found.shares[2] <= chance(0.01, found.runs)


def share_bounds_of(
    pieces: NDArray[np.bool_], allowed: float, confidence: float, starts: tuple[int, ...] = ()
) -> ShareBounds:
    """The bounds on a share of one run."""
    test = ShareLimit(allowed, confidence, scatter_level(confidence))
    careful = scatter_level(confidence, of_shares=True)
    return bounds_of_flags(list(pieces), starts, test, careful)


def share_outcome(
    pieces: NDArray[np.bool_],
    allowed: float,
    confidence: float = CONFIDENCE,
    starts: tuple[int, ...] = (),
) -> int:
    """The test of one run."""
    found = share_bounds_of(pieces, allowed, confidence, starts)
    return int(found.upper <= allowed) - int(found.lower > allowed)


def percentile_outcome(
    values: Values, limit: float, allowed: float, confidence: float, starts: tuple[int, ...] = ()
) -> int:
    """The test of one run, whose percentile has to be as far from the limit as levels scatter."""
    level = scatter_level(confidence)
    bounds = bounds_of_flags(list(values > limit), starts, ShareLimit(allowed, confidence, level))
    found = int(bounds.upper <= allowed) - int(bounds.lower > allowed)
    levels = level_margin(list(values), starts, 1 - allowed, level)
    below, above = (levels.half, levels.tail) if levels is not None else (0.0, 0.0)
    estimate = float(np.sort(values, axis=None)[rank(1 - allowed, values.size) - 1])
    clear = estimate + above <= limit if found > 0 else estimate - below > limit
    return found if clear else 0


def ratio_outcome(interval: RatioInterval, limit: float = 1.0) -> int:
    """``>= limit of baseline``."""
    return int(interval.lower >= limit) - int(interval.upper < limit)


def heads(pairs: int, seed: int) -> NDArray[np.bool_]:
    """Which of the runs of so many pairs are of the head, in the order in which they are played."""
    return np.array([letter == "B" for order in pair_orders(pairs, seed) for letter in order])


def paired_values(
    random: np.random.Generator,
    runs: int,
    pairs: int,
    ratio: float,
    variation: float = 0.02,
    drift: float = 0.1,
) -> tuple[Values, Values]:
    """Base and head of interleaved runs, shape (runs, pairs) each.

    Each value varies by itself; all share a machine that gets slower by `drift` over the run, in
    an order that a coin decides, and another machine of the day for each run.
    """
    is_head = np.array([heads(pairs, seed) for seed in random.integers(2**32, size=runs).tolist()])
    time = np.linspace(0, drift, 2 * pairs)
    day = random.normal(0, 0.05, (runs, 1))
    noise = random.normal(0, variation, (runs, 2 * pairs))
    level = np.exp(np.log(100.0) + day + noise - time + is_head * np.log(ratio))
    return level[~is_head].reshape(runs, pairs), level[is_head].reshape(runs, pairs)


def ratio_gate(
    ratio: Callable[[list[float], list[float], float], RatioInterval],
    base: Values,
    head: Values,
    limit: float = 1.0,
) -> Errors:
    """``>= limit of baseline`` by an interval of the ratios of rows of `head` and `base`."""
    rows = zip(base.tolist(), head.tolist(), strict=True)
    return Errors.of(ratio_outcome(ratio(*row, CONFIDENCE), limit) for row in rows)


def paired_gate(
    ratio: float,
    limit: float,
    *,
    pairs: int = 10,
    runs: int,
    variation: float = 0.02,
    seed: int = 1,
) -> Errors:
    """``>= limit of baseline`` by interleaved pairs, if the true ratio is `ratio`."""
    random = np.random.default_rng(seed)
    return ratio_gate(paired_ratio, *paired_values(random, runs, pairs, ratio, variation), limit)


# Gates whose failures are confirmed by a fresh batch.

# Worlds of successive runs; two of them differ by 2.7 %.

RunWorld = Callable[[np.random.Generator, int], Values]
"""The logarithms of the values of so many successive runs, each with fresh processes."""

_SCATTER = 0.019


def _alike(random: np.random.Generator, runs: int) -> Values:
    return random.normal(0, _SCATTER, runs)


def _resembling(random: np.random.Generator, runs: int) -> Values:
    noise = random.normal(0, _SCATTER * math.sqrt(0.75), runs + 20)
    return np.asarray(signal.lfilter([1], [1, -0.5], noise)[20:])


def _with_step(random: np.random.Generator, runs: int) -> Values:
    """One of the runs but for the first and the last is the first on a machine that is slower."""
    return np.asarray(
        _alike(random, runs) - 0.1 * (np.arange(runs) >= random.integers(1, max(runs - 1, 2)))
    )


def _loaded(period: int) -> RunWorld:
    def world(random: np.random.Generator, runs: int) -> Values:
        first = int(random.integers(period))
        taken = np.where(np.arange(runs) % period == first, 0.4, 0.02)
        return np.asarray(_alike(random, runs) + np.log1p(-taken))

    return world


RUN_WORLDS: dict[str, RunWorld] = {
    "the machine is slower from some run on": _with_step,
    "runs differ by 2.7 %": _alike,
    "each run is slower by 0.5 %": lambda random, runs: (
        _alike(random, runs) - 0.005 * np.arange(runs)
    ),
    "runs resemble (0.5)": _resembling,
    "the machine wanders by 1 % a run": lambda random, runs: (
        _alike(random, runs) + np.cumsum(random.normal(0, 0.01, runs))
    ),
    "1 run in 10 is disturbed by a fifth": lambda random, runs: (
        _alike(random, runs) - 0.2 * (random.random(runs) < 0.1)
    ),
    "skewed differences": lambda random, runs: -0.02 * random.exponential(1, runs),
    "others take 10 to 50 % of the time": lambda random, runs: (
        _alike(random, runs) + np.log1p(-random.uniform(0.1, 0.5, runs))
    ),
    "others take 40 % from 3 runs in 10": lambda random, runs: (
        _alike(random, runs) + np.log1p(-np.where(random.random(runs) < 0.3, 0.4, 0.02))
    ),
    "others take 0 % at first, a half in the end": lambda random, runs: (
        _alike(random, runs) + np.log1p(-np.linspace(0, 0.5, runs))
    ),
    **{f"others take 40 % from every {period}. run": _loaded(period) for period in (2, 3, 4)},
}
"""On a busy machine others take a share of the time from a run, by which its value is smaller."""


def pairs_errors(
    world: RunWorld, *, pairs: int = 10, runs: int, ratio: float = 1.0, limit: float = 1.0
) -> Errors:
    """Interleaved pairs in the order of a coin; a failure is confirmed by half as many more.

    Args:
        world: of successive runs.
        pairs: before a failure.
        runs: how many comparisons.
        ratio: of the head to the base, in truth.
        limit: of ``>= limit of baseline``.
    """
    random, found, more = np.random.default_rng(1), Errors(runs), pairs_that_confirm(pairs)
    looks = InterimLooks.after_pairs(pairs, pairs + more)

    def outcome(base: Values, head: Values, look: int) -> int:
        end, confidence = looks.iterations[look - 1], looks.confidence_at(look)
        interval = paired_ratio(base[:end].tolist(), head[:end].tolist(), confidence)
        return ratio_outcome(interval, limit)

    for seed in random.integers(2**32, size=runs).tolist():
        order = np.concatenate([heads(pairs, seed), heads(more, seed + 1)])
        values = np.exp(world(random, order.size) + order * math.log(ratio))
        sides = values[~order], values[order]
        found.add(outcome(*sides, look=1), partial(outcome, *sides, look=2))
    return found
