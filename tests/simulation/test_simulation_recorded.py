"""The effective number of messages on latencies that were recorded, not made up.

``relay_50hz.npy``: a RelayNode of 6 ms, twelve iterations of 20 s at 50 Hz, on a machine of two
cores with background load in bursts (float32 seconds, one row for each iteration, NaN where lost).
`benchmarks/estimators.py` compares estimators on recordings of any size.
"""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from nightly import size

sys.path.append(str(Path(__file__).parents[2] / "benchmarks"))

from estimators import recorded, wrong

pytestmark = pytest.mark.simulation

((_, LATENCY),) = recorded(Path(__file__).with_name("relay_50hz.npy"))


@pytest.mark.parametrize(("quantile", "messages"), [(0.5, 30), (0.9, 100)])
def test_the_largest_of_three_is_far_less_often_wrong(quantile: float, messages: int) -> None:
    found = wrong(LATENCY, quantile, 10, messages, runs=size(60, 300))
    passed, failed = found["as used"]
    for other in ("one by one", "lag-1"):
        assert passed <= found[other][0] / 2
        assert failed <= found[other][1] / 2
    assert failed <= 0.06
    assert passed <= 0.12
    assert max(found["as judged"]) <= 0.08


def test_of_a_p99_most_runs_have_met_too_few_bursts() -> None:
    """No estimate of the bad messages that came tells of those that did not."""
    found = wrong(LATENCY, 0.99, 10, 300, runs=size(60, 300))
    assert found["as judged"][0] <= found["as used"][0]
    assert found["as judged"][1] <= 0.05
    assert found["as used"][0] <= found["one by one"][0]
    assert found["as used"][1] <= 0.05
