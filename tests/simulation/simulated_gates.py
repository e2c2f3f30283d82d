"""How often a gate passes and fails in simulated runs, by each of its methods."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from simulated_worlds import World

from r2bspec.judge.baseline_comparison import HISTORY_CONFIRMATION_CONFIDENCE
from r2bspec.judge.decision_policy import InterimLooks
from r2bspec.judge.statistics.autocorrelation import serial_inflation
from r2bspec.judge.statistics.binomial import lower_bound, upper_bound
from r2bspec.judge.statistics.effective_sample_size import SampleDesign, effective_sample
from r2bspec.judge.statistics.t_interval import (
    RatioInterval,
    mean_interval,
    pair_orders,
    paired_ratio,
    predicted_ratio,
    welch_ratio,
)

CONFIDENCE = 0.95


@dataclass(frozen=True)
class Rates:
    """Shares of runs."""

    passed: float
    failed: float

    @classmethod
    def of(cls, outcomes: list[int]) -> Rates:
        """Count outcomes: 1 is a pass, -1 a fail, 0 open."""
        found = np.array(outcomes)
        return cls(float(np.mean(found > 0)), float(np.mean(found < 0)))

    def __str__(self) -> str:
        return f"{100 * self.passed:.1f} / {100 * self.failed:.1f}"


@dataclass
class Errors:
    """Counts of runs: passes, fails, and fails that were confirmed."""

    runs: int
    counts: NDArray[np.int64] = field(default_factory=lambda: np.zeros(3, dtype=np.int64))

    def add(self, outcome: int, confirm: Callable[[], int] = lambda: 0) -> None:
        """Count an outcome (1 is a pass, -1 a fail), and that of the confirmation of a fail."""
        self.counts += (outcome > 0, outcome < 0, outcome < 0 and confirm() < 0)

    @property
    def shares(self) -> tuple[float, float, float]:
        passed, failed, confirmed = (self.counts / self.runs).tolist()
        return passed, failed, confirmed

    def __str__(self) -> str:
        return " / ".join(f"{100 * share:.1f}" for share in self.shares)


def share_outcome(
    pieces: NDArray[np.bool_],
    allowed: float,
    confidence: float = CONFIDENCE,
    *,
    plain: bool = False,
) -> int:
    """The exact binomial test of one run, on its effective number or on the plain one."""
    worth = effective_sample(list(pieces), SampleDesign(allowed=allowed, confidence=confidence))
    f = 1.0 if plain else worth.inflation
    if upper_bound(worth.bad / f, worth.n / f, confidence) <= allowed:
        return 1
    return -1 if lower_bound(worth.bad / f, worth.n / f, confidence) > allowed else 0


def share_gate(
    world: World,
    truth: float,
    allowed: float,
    *,
    runs: int,
    messages: int = 300,
    iterations: int = 10,
    plain: bool = False,
    seed: int = 1,
) -> Rates:
    """A percentile or share requirement in many runs."""
    random = np.random.default_rng(seed)
    flags = world(random, (runs, iterations, messages), truth)
    return Rates.of([share_outcome(run, allowed, plain=plain) for run in flags])


def mean_gate(values: NDArray[np.float64], limit: float) -> Rates:
    """``mean < limit`` by t over iterations; `values` is (runs, iterations)."""
    intervals = [
        mean_interval(run, CONFIDENCE, inflation=serial_inflation(run)) for run in values.tolist()
    ]
    return Rates.of([(one.upper < limit) - (one.lower >= limit) for one in intervals])


def looked_gate(
    flags: NDArray[np.bool_], allowed: float, looks: InterimLooks, *, planned: bool = True
) -> tuple[Rates, float]:
    """A share requirement at looks; and how many iterations were played, in the mean.

    Not `planned`: each look decides at the full confidence, as extending a run until it passes.
    """
    outcomes, played = [], []
    for run in flags:
        outcome = 0
        for look, end in enumerate(looks.iterations, start=1):
            confidence = looks.confidence_at(look) if planned else CONFIDENCE
            outcome = share_outcome(run[:end], allowed, confidence)
            if outcome:
                break
        outcomes.append(outcome)
        played.append(end)
    return Rates.of(outcomes), float(np.mean(played))


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
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
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


def ratio_outcome(interval: RatioInterval, limit: float) -> int:
    """``>= limit of baseline``."""
    return int(interval.lower >= limit) - int(interval.upper < limit)


def add_history_run(found: Errors, earlier: list[float], new: float, fresh: float) -> None:
    """Count a run against earlier ones; the run that confirms its failure meets the same ones."""

    def judged(value: float, confidence: float) -> int:
        return ratio_outcome(predicted_ratio(earlier, value, confidence), 1.0)

    found.add(judged(new, CONFIDENCE), lambda: judged(fresh, HISTORY_CONFIRMATION_CONFIDENCE))


def paired_gate(
    ratio: float,
    limit: float,
    *,
    pairs: int = 10,
    runs: int,
    variation: float = 0.02,
    seed: int = 1,
) -> Rates:
    """``>= limit of baseline`` by interleaved pairs, if the true ratio is `ratio`."""
    random = np.random.default_rng(seed)
    base, head = paired_values(random, runs, pairs, ratio, variation)
    return Rates.of(
        [
            ratio_outcome(paired_ratio(a, b, CONFIDENCE), limit)
            for a, b in zip(base.tolist(), head.tolist(), strict=True)
        ]
    )


def bootstrap_gate(ratio: float, *, pairs: int, runs: int, seed: int = 1) -> Rates:
    """The same with a percentile bootstrap of the mean ratio, and the limit at the truth."""
    random = np.random.default_rng(seed)
    base, head = paired_values(random, runs, pairs, ratio)
    drawn = random.integers(0, pairs, (runs, 500, pairs))
    rows = np.arange(runs)[:, np.newaxis, np.newaxis]
    means = (head / base)[rows, drawn].mean(axis=2)
    lower, upper = np.quantile(means, [1 - CONFIDENCE, CONFIDENCE], axis=1)
    return Rates(float(np.mean(lower >= ratio)), float(np.mean(upper < ratio)))


def run_values(
    random: np.random.Generator, runs: int, iterations: int, between: float = 0.027
) -> NDArray[np.float64]:
    """Stored runs of one graph: they differ by `between`, their iterations by 1 % on top."""
    level = random.normal(0, between / np.sqrt(2), (runs, 1))
    return np.exp(level + random.normal(0, 0.01, (runs, iterations)))


def stored_gate(iterations: int, *, runs: int, seed: int = 1) -> Rates:
    """Two stored runs of one graph by Welch's test: ``>= 100 % of baseline``."""
    random = np.random.default_rng(seed)
    base, head = (run_values(random, runs, iterations) for _ in range(2))
    return Rates.of(
        [
            ratio_outcome(welch_ratio(a, b, CONFIDENCE), 1.0)
            for a, b in zip(base.tolist(), head.tolist(), strict=True)
        ]
    )


def history_gate(
    ratio: float, limit: float, *, history: int, iterations: int = 10, runs: int, seed: int = 1
) -> Rates:
    """A new run against a history of runs: ``>= limit of baseline``."""
    random = np.random.default_rng(seed)
    outcomes = []
    for _ in range(runs):
        earlier = run_values(random, history, iterations).mean(axis=1).tolist()
        new = float(run_values(random, 1, iterations).mean()) * ratio
        outcomes.append(ratio_outcome(predicted_ratio(earlier, new, CONFIDENCE), limit))
    return Rates.of(outcomes)
