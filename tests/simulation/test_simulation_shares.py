"""Percentiles and shares on the limit: how often a requirement passes or fails wrongly.

Promise: at most 5 % each way, also where bad messages come in bursts or stretches, remember each
other, drift, or differ between iterations. What no test can see is stated as what it is.
"""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats
from simulated_gates import share_gate
from simulated_worlds import WORLDS, bursts, stationary

from nightly import noise, size
from simulated_runs import judged

pytestmark = pytest.mark.simulation

RUNS = size(120, 1000)
LEVEL = 0.05
NOISE = 2 * np.sqrt(LEVEL * (1 - LEVEL) / RUNS) + noise(0.02)
"""Two standard errors of a share of 5 % of that many runs, and a little more of few."""

FEW_BURSTS = {"bursts of 20", "autocorrelated, 0.9"}
"""Worlds in which 3,000 messages hold so few bursts of bad ones at p99 that some runs see none."""


@pytest.mark.parametrize("name", WORLDS)
@pytest.mark.parametrize("allowed", [0.1, 0.01])
def test_both_errors_are_at_most_five_percent(name: str, allowed: float) -> None:
    found = share_gate(WORLDS[name], allowed, allowed, runs=RUNS)
    assert found.failed <= LEVEL + noise(0.06)
    # At p90 there are bursts enough for any world.
    if name != "uneven iterations" and (name not in FEW_BURSTS or allowed == 0.1):
        assert found.passed <= LEVEL + NOISE


@pytest.mark.parametrize(
    ("name", "allowed", "most"), [("uneven iterations", 0.1, 0.1), ("bursts of 5", 0.01, 0.06)]
)
def test_of_messages_counted_one_by_one_a_quarter_pass(
    name: str, allowed: float, most: float
) -> None:
    plain, found = (
        share_gate(WORLDS[name], allowed, allowed, runs=RUNS, plain=plain)
        for plain in (True, False)
    )
    assert plain.passed > 0.25
    assert found.passed < most + noise(0.06)


def test_bursts_of_twenty_stay_undecided_at_p99_unless_none_came() -> None:
    random = np.random.default_rng(7)
    flags = bursts(20)(random, (RUNS, 10, 300), 0.01)
    none_came = float(np.mean(~flags.any(axis=(1, 2))))
    found = share_gate(bursts(20), 0.01, 0.01, runs=RUNS, seed=7)
    assert found.passed <= none_came + LEVEL + noise(0.06)
    assert found.failed <= 0.02 + noise(0.04)


def test_the_cost_of_care_is_small_where_messages_are_independent() -> None:
    """Counts of few bad messages hardly show whether iterations are correlated: 10,000 do."""
    for truth in (0.002, 0.02):
        plain = share_gate(stationary, truth, 0.01, runs=size(60, 300), messages=1000, plain=True)
        found = share_gate(stationary, truth, 0.01, runs=size(60, 300), messages=1000)
        assert found.passed >= plain.passed - 0.03
        assert found.failed >= plain.failed - 0.03


def test_whole_runs_are_no_more_often_wrong_than_single_tests() -> None:
    """The verdict asks the test of every limit on one side: that makes it more careful only."""
    random, runs = np.random.default_rng(8), size(40, 200)
    limit_ms = float(stats.lognorm.ppf(0.9, 0.4)) * 20
    outcomes = [
        judged(
            stats.lognorm.rvs(0.4, scale=0.02, size=(10, 100), random_state=random),
            f"latency.p90 < {limit_ms:.6f} ms",
        ).outcome
        for _ in range(runs)
    ]
    assert outcomes.count("pass") <= (LEVEL + 0.03 + noise(0.06)) * runs
    assert outcomes.count("fail") <= (LEVEL + 0.03 + noise(0.06)) * runs


def test_windows_are_judged_at_their_level() -> None:
    random, runs = np.random.default_rng(9), size(30, 100)
    outcomes = []
    for _ in range(runs):
        bad = np.repeat(random.random((10, 10)) < 0.1, 30, axis=1)
        latency = np.where(bad, 0.1, 0.02) + random.uniform(0, 0.001, bad.shape)
        asked = "latency.p50 < 60 ms in 90 % of 1 s windows"
        outcomes.append(judged(latency, asked).outcome)
    assert outcomes.count("pass") <= (0.1 + noise(0.06)) * runs
    assert outcomes.count("fail") <= (0.1 + noise(0.06)) * runs
