"""Comparisons of one graph with itself, in pairs and with a history, in a world of worlds.

Each value is that of a whole run with fresh processes. Worlds say how the values of successive runs
come about; the true ratio is 1 and so is the limit, where a comparison is wrong most often.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy import signal
from simulated_gates import CONFIDENCE, Errors, add_history_run, heads, ratio_outcome
from simulated_starts import Shape, StartWorld

from r2bspec.judge.statistics.t_interval import RunValues, paired_ratio, welch_ratio_of_runs
from r2bspec.language.benchmark_defaults import CONFIRMATION_CONFIDENCE

Logs = NDArray[np.float64]
RunWorld = Callable[[np.random.Generator, int], Logs]
"""The logarithms of the values of so many successive runs."""

_SCATTER = 0.019
"""Two runs then differ by 2.7 %."""


def _alike(random: np.random.Generator, runs: int) -> Logs:
    return random.normal(0, _SCATTER, runs)


def _drifting(random: np.random.Generator, runs: int) -> Logs:
    return _alike(random, runs) - 0.005 * np.arange(runs)


def _resembling(random: np.random.Generator, runs: int) -> Logs:
    noise = random.normal(0, _SCATTER * math.sqrt(0.75), runs + 20)
    return np.asarray(signal.lfilter([1], [1, -0.5], noise)[20:])


def _wandering(random: np.random.Generator, runs: int) -> Logs:
    return _alike(random, runs) + np.cumsum(random.normal(0, 0.01, runs))


def _disturbed(random: np.random.Generator, runs: int) -> Logs:
    return _alike(random, runs) - 0.2 * (random.random(runs) < 0.1)


def _skewed(random: np.random.Generator, runs: int) -> Logs:
    return -0.02 * random.exponential(1, runs)


RUN_WORLDS: dict[str, RunWorld] = {
    "runs differ by 2.7 %": _alike,
    "each run is slower by 0.5 %": _drifting,
    "runs resemble (0.5)": _resembling,
    "the machine wanders by 1 % a run": _wandering,
    "1 run in 10 is disturbed by a fifth": _disturbed,
    "skewed differences": _skewed,
}


def pairs_errors(world: RunWorld, *, pairs: int = 10, runs: int, seed: int = 1) -> Errors:
    """Interleaved pairs in the order of a coin; a failure is confirmed by as many fresh pairs."""
    random = np.random.default_rng(seed)
    found = Errors(runs)

    def one(confidence: float) -> int:
        values = np.exp(world(random, 2 * pairs))
        order = heads(pairs, int(random.integers(2**32)))
        interval = paired_ratio(values[~order].tolist(), values[order].tolist(), confidence)
        return ratio_outcome(interval, 1.0)

    for _ in range(runs):
        found.add(one(CONFIDENCE), lambda: one(CONFIRMATION_CONFIDENCE))
    return found


def stored_errors(
    world: StartWorld, shape: Shape, *, by_starts: bool = True, runs: int, seed: int = 1
) -> Errors:
    """Two stored runs of one graph by Welch's test, with or without regard to their starts."""
    random = np.random.default_rng(seed)
    starts = shape.numbers if by_starts else ()
    found = Errors(runs)

    def one() -> RunValues:
        return RunValues(world.run(random, shape).mean(axis=1).tolist(), starts)

    for _ in range(runs):
        interval, _ = welch_ratio_of_runs(one(), one(), CONFIDENCE)
        found.add(ratio_outcome(interval, 1.0))
    return found


def history_errors(world: RunWorld, *, history: int = 10, runs: int, seed: int = 1) -> Errors:
    """A new run against earlier ones; a failure is confirmed by a run that meets the same ones."""
    random = np.random.default_rng(seed)
    found = Errors(runs)
    for _ in range(runs):
        *earlier, new, fresh = np.exp(world(random, history + 2)).tolist()
        add_history_run(found, earlier, new, fresh)
    return found
