"""The effective number of messages on latencies that were recorded, not made up.

``relay_50hz.npy``: a RelayNode of 6 ms, twelve iterations of 20 s at 50 Hz, on a machine of two
cores with background load in bursts (float32 seconds, one row for each iteration, NaN where lost).
Its own percentile, over everything, is taken for the truth, and a run is made of pieces of it: ten
stretches, each from a place of its own, at random. Requirements lie exactly on the truth: a PASS
is wrong, and so is a FAIL.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from simulated_gates import CONFIDENCE, Errors, chance, percentile_outcome, share_outcome

from nightly import size
from r2bspec.judge.measure.times import rank

pytestmark = pytest.mark.simulation

LATENCY = np.nan_to_num(np.load(Path(__file__).with_name("relay_50hz.npy")), nan=np.inf)
PIECES = 10


def wrong(quantile: float, messages: int) -> tuple[Errors, Errors]:
    """Wrong outcomes of requirements on a quantile of so many messages a piece: by counts, judged.

    A percentile is judged by how much levels differ, too.
    """
    limit = float(np.sort(LATENCY, axis=None)[rank(quantile, LATENCY.size) - 1])
    truth = float((limit < LATENCY).mean())
    random = np.random.default_rng(1)
    counted, judged = [], []
    for _ in range(size(60, 300)):
        rows = random.integers(0, LATENCY.shape[0], PIECES)
        starts = random.integers(0, LATENCY.shape[1] - messages + 1, PIECES)
        run = LATENCY[rows[:, np.newaxis], starts[:, np.newaxis] + np.arange(messages)]
        counted.append(share_outcome(run > limit, truth))
        judged.append(percentile_outcome(run, limit, truth, CONFIDENCE))
    return Errors.of(counted), Errors.of(judged)


@pytest.mark.parametrize(("quantile", "messages"), [(0.5, 30), (0.9, 100)])
def test_errors_on_recorded_latencies(quantile: float, messages: int) -> None:
    """Of messages counted one by one, twice as many and more would pass or fail wrongly."""
    counted, judged = wrong(quantile, messages)
    assert counted.failed <= 0.06
    assert counted.passed <= 0.12
    assert max(judged.shares) <= chance(0.05, judged.runs)


def test_of_a_p99_most_runs_have_met_too_few_bursts() -> None:
    """No estimate of the bad messages that came tells of those that did not."""
    counted, judged = wrong(0.99, 300)
    assert judged.passed <= counted.passed
    assert max(judged.failed, counted.failed) <= 0.05
