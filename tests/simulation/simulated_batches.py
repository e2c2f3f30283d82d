"""A/A gates of each kind: a graph that just meets its requirement, judged, and confirmed.

Each returns the outcome of one batch, 1 for a pass and -1 for a fail, at a confidence. The truth
lies exactly on the limit, where a gate is wrong most often; each batch is drawn anew.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from simulated_gates import (
    Errors,
    add_history_run,
    paired_values,
    ratio_outcome,
    run_values,
    share_outcome,
)
from simulated_worlds import bursts, stationary

from r2bspec.judge.decision_policy import InterimLooks
from r2bspec.judge.statistics.autocorrelation import serial_inflation
from r2bspec.judge.statistics.t_interval import mean_interval, paired_ratio
from r2bspec.language.benchmark_defaults import CONFIRMATION_CONFIDENCE

Batch = Callable[[np.random.Generator, float], int]


def percentile(random: np.random.Generator, confidence: float) -> int:
    """Bursts of 5, p99, 3,000 messages."""
    return share_outcome(bursts(5)(random, (1, 10, 300), 0.01)[0], 0.01, confidence)


def drops(random: np.random.Generator, confidence: float) -> int:
    """Independent losses, 5 % of which are allowed, 1,000 messages."""
    return share_outcome(stationary(random, (1, 10, 100), 0.05)[0], 0.05, confidence)


def mean(random: np.random.Generator, confidence: float) -> int:
    """The mean of 10 iterations that differ by 2 %."""
    values = random.normal(1, 0.02, 10).tolist()
    found = mean_interval(values, confidence, inflation=serial_inflation(values))
    return int(found.upper < 1) - int(found.lower >= 1)


def windows(random: np.random.Generator, confidence: float) -> int:
    """``in 90 % of 1 s windows``: 10 iterations of 20 windows, bad ones in bursts of 2."""
    return share_outcome(bursts(2)(random, (1, 10, 20), 0.1)[0], 0.1, confidence)


def looked(random: np.random.Generator, confidence: float) -> int:
    """p90 with looks at 10, 20 and 40 iterations of 75 messages."""
    run = stationary(random, (1, 40, 75), 0.1)[0]
    looks = InterimLooks((10, 20, 40))
    for look, end in enumerate(looks.iterations, start=1):
        outcome = share_outcome(run[:end], 0.1, looks.confidence_at(look, confidence))
        if outcome:
            return outcome
    return 0


def paired(random: np.random.Generator, confidence: float) -> int:
    """Ten interleaved pairs of one graph, with no margin."""
    base, head = paired_values(random, 1, 10, 1.0)
    return ratio_outcome(paired_ratio(base[0].tolist(), head[0].tolist(), confidence), 1.0)


KINDS: dict[str, Batch] = {
    "percentile, bursts of 5": percentile,
    "drop rate": drops,
    "mean over iterations": mean,
    "windows": windows,
    "looks at 1x, 2x, 4x": looked,
    "interleaved pairs": paired,
}


def aa_gates(batch: Batch, *, gates: int = 600, seed: int = 1) -> Errors:
    """Many A/A gates, each failure of which is confirmed by a fresh batch or not."""
    random = np.random.default_rng(seed)
    found = Errors(gates)
    for _ in range(gates):
        found.add(batch(random, 0.95), lambda: batch(random, CONFIRMATION_CONFIDENCE))
    return found


def history_gates(*, gates: int = 600, seed: int = 1) -> Errors:
    """Runs of the same graph against ten earlier ones, with no margin.

    The fresh run after a failure meets the same history, at `HISTORY_CONFIRMATION_CONFIDENCE`.
    """
    random = np.random.default_rng(seed)
    found = Errors(gates)
    for _ in range(gates):
        earlier = run_values(random, 10, 10).mean(axis=1).tolist()
        add_history_run(found, earlier, *run_values(random, 2, 10).mean(axis=1).tolist())
    return found
