"""Means by t over iterations: errors on the limit, and power."""

from __future__ import annotations

import numpy as np
import pytest
from simulated_gates import MEAN_WORLDS, mean_gate

pytestmark = pytest.mark.simulation

RUNS = 2000


@pytest.mark.parametrize(
    ("world", "passed", "failed"),
    [
        # Few iterations hardly show that each resembles the one before: docs/verdicts.md says so.
        ("each like the one before (r = 0.5)", 0.17, 0.17),
        ("messages like those before (r = 0.9)", 0.05, 0.05),
        ("drifting by 6 %", 0.05, 0.05),
        # The mean of 300 skewed messages is skewed still: too few runs see the tail.
        ("log-normal messages (sigma 1), 300 each", 0.075, 0.05),
        ("Pareto messages (index 3), 300 each", 0.075, 0.05),
    ],
)
def test_errors_on_the_limit(world: str, passed: float, failed: float) -> None:
    found = mean_gate(MEAN_WORLDS[world](np.random.default_rng(6), RUNS, 10))
    assert found.passed <= passed
    assert found.failed <= failed


@pytest.mark.parametrize("iterations", [3, 5, 10, 20])
def test_independent_iterations_are_wrong_as_often_as_stated(iterations: int) -> None:
    world = MEAN_WORLDS["stationary, 2 % variation"]
    found = mean_gate(world(np.random.default_rng(1), RUNS, iterations))
    assert 0.025 <= found.passed <= 0.055
    assert 0.025 <= found.failed <= 0.055


def test_power() -> None:
    random = np.random.default_rng(5)
    for slower, iterations, least in ((1.12, 3, 0.85), (1.06, 10, 0.75)):
        values = random.normal(slower, 0.02 * slower, (500, iterations))
        assert mean_gate(values, 1.03).failed >= least
