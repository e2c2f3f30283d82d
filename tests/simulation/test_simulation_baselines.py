"""Base against head in interleaved pairs."""

from __future__ import annotations

import pytest
from simulated_gates import paired_gate
from simulated_pair_looks import HEADS, errors_of_pairs

from nightly import noise, sampled, size

pytestmark = pytest.mark.simulation

RUNS = size(500, 3000)
GATES = size(300, 2000)


@pytest.mark.parametrize("pairs", sampled([2, 3, 5, 10, 20], 2))
def test_equal_graphs_fail_in_at_most_five_percent_and_never_with_a_margin(pairs: int) -> None:
    assert paired_gate(1.0, 1.0, pairs=pairs, runs=RUNS).failed <= 0.06 + noise(0.03)
    assert paired_gate(1.0, 0.95, pairs=pairs, runs=size(100, 600)).failed == 0


@pytest.mark.parametrize("quantity", ["mean", "p99"])
@pytest.mark.parametrize("head", HEADS)
def test_pairs_that_may_end_early_pass_no_oftener_where_something_is_rare(
    head: str, quantity: str
) -> None:
    runs = size(10, 400)
    early = errors_of_pairs(head, quantity, 10, runs=runs)
    whole = errors_of_pairs(head, quantity, 10, looks=False, runs=runs)
    assert early.passed <= whole.passed + 0.02 + noise(0.1)
