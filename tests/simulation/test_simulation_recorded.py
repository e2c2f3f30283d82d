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
from numpy.typing import NDArray
from simulated_gates import CONFIDENCE, Errors, percentile_outcome, share_outcome, share_test

from nightly import size
from r2bspec.judge.measure.times import rank

pytestmark = pytest.mark.simulation

LATENCY = np.nan_to_num(np.load(Path(__file__).with_name("relay_50hz.npy")), nan=np.inf)
PIECES = 10


def lag_1(flags: NDArray[np.bool_]) -> float:
    """(1 + r) / (1 - r) with the lag-1 autocorrelation of the flags, within pieces."""
    deviations = flags - flags.mean()
    variance = float((deviations**2).mean())
    if not variance:
        return 1.0
    r = float((deviations[:, 1:] * deviations[:, :-1]).mean()) / variance
    return max(1.0, (1 + r) / (1 - r)) if r < 1 else float(flags.size)


def wrong(quantile: float, messages: int) -> dict[str, Errors]:
    """Wrong outcomes of requirements on a quantile, by estimator, of so many messages a piece."""
    limit = float(np.sort(LATENCY, axis=None)[rank(quantile, LATENCY.size) - 1])
    truth = float((limit < LATENCY).mean())
    random = np.random.default_rng(1)
    outcomes: dict[str, list[int]] = {}
    for _ in range(size(60, 300)):
        rows = random.integers(0, LATENCY.shape[0], PIECES)
        starts = random.integers(0, LATENCY.shape[1] - messages + 1, PIECES)
        run = LATENCY[rows[:, np.newaxis], starts[:, np.newaxis] + np.arange(messages)]
        over = run > limit
        n, bad, f = over.size, int(over.sum()), lag_1(over)
        for name, outcome in (
            ("one by one", share_test(bad, n, truth)),
            ("lag-1", share_test(bad / f, n / f, truth)),
            ("as used", share_outcome(over, truth)),
            ("as judged", percentile_outcome(run, limit, truth, CONFIDENCE)),
        ):
            outcomes.setdefault(name, []).append(outcome)
    return {name: Errors.of(found) for name, found in outcomes.items()}


@pytest.mark.parametrize(("quantile", "messages"), [(0.5, 30), (0.9, 100)])
def test_the_largest_of_three_is_far_less_often_wrong(quantile: float, messages: int) -> None:
    found = wrong(quantile, messages)
    used = found["as used"]
    for other in ("one by one", "lag-1"):
        assert used.passed <= found[other].passed / 2
        assert used.failed <= found[other].failed / 2
    assert used.failed <= 0.06
    assert used.passed <= 0.12
    assert max(found["as judged"].shares) <= 0.08


def test_of_a_p99_most_runs_have_met_too_few_bursts() -> None:
    """No estimate of the bad messages that came tells of those that did not."""
    found = wrong(0.99, 300)
    used = found["as used"]
    assert found["as judged"].passed <= used.passed <= found["one by one"].passed
    assert found["as judged"].failed <= 0.05
    assert used.failed <= 0.05
