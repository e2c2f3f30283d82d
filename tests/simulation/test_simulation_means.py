"""Means by t over iterations: errors on the limit, and power."""

from __future__ import annotations

import numpy as np
import pytest
from simulated_gates import MEAN_WORLDS, mean_gate

pytestmark = pytest.mark.simulation

RUNS = 2000


@pytest.mark.parametrize(
    ("world", "iterations", "passed", "failed"),
    [
        # Few iterations hardly show that each resembles the one before: docs/verdicts.md says so.
        ("each like the one before (r = 0.5)", 10, 0.19, 0.19),
        ("messages like those before (r = 0.9)", 10, 0.06, 0.06),
        ("drifting by 6 %", 10, 0.05, 0.05),
        # The mean of 300 skewed messages is skewed still: too few runs see the tail.
        ("log-normal messages (sigma 1), 300 each", 10, 0.085, 0.05),
        ("Pareto messages (index 3), 300 each", 10, 0.085, 0.05),
    ],
)
def test_errors_on_the_limit(world: str, iterations: int, passed: float, failed: float) -> None:
    found = mean_gate(MEAN_WORLDS[world](np.random.default_rng(6), RUNS, iterations))
    assert found.passed <= passed
    assert found.failed <= failed


@pytest.mark.parametrize("iterations", [3, 5, 10, 20])
def test_independent_iterations_are_wrong_as_often_as_stated(iterations: int) -> None:
    world = MEAN_WORLDS["stationary, 2 % variation"]
    found = mean_gate(world(np.random.default_rng(1), RUNS, iterations))
    assert 0.035 <= found.passed <= 0.065
    assert 0.035 <= found.failed <= 0.065


def test_power() -> None:
    random = np.random.default_rng(5)
    for slower, iterations, least in ((1.12, 3, 0.85), (1.06, 10, 0.75)):
        values = random.normal(slower, 0.02 * slower, (500, iterations))
        assert mean_gate(values, 1.03).failed >= least
