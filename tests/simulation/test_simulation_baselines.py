"""Base against head in interleaved pairs."""

from __future__ import annotations

import math

import numpy as np
import pytest
from simulated_gates import Values, paired_gate, pairs_errors

from nightly import noise, sampled, size

pytestmark = pytest.mark.simulation

RUNS = size(500, 3000)
GATES = size(300, 2000)


@pytest.mark.parametrize("pairs", sampled([2, 3, 5, 10, 20], 2))
def test_equal_graphs_fail_in_at_most_five_percent_and_never_with_a_margin(pairs: int) -> None:
    assert paired_gate(1.0, 1.0, pairs=pairs, runs=RUNS).failed <= 0.06 + noise(0.03)
    assert paired_gate(1.0, 0.95, pairs=pairs, runs=size(100, 600)).failed == 0


@pytest.mark.parametrize(("starts", "pairs"), [(0.027, 5), (0.05, 10), (0.1, 40)][: size(2, 3)])
def test_a_graph_that_is_fifteen_percent_slower_is_found(starts: float, pairs: int) -> None:
    def world(random: np.random.Generator, runs: int) -> Values:
        return random.normal(0, starts / math.sqrt(2), runs)

    found = pairs_errors(world, pairs=pairs, runs=GATES, ratio=1 / 1.15, limit=1 / 1.05)
    assert found.shares[2] >= 0.95
