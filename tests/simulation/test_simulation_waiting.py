"""Run-queue waits: no wrong fails by them, and an overloaded graph fails on a busy machine."""

from __future__ import annotations

import pytest
from simulated_waiting import fails

from nightly import sampled, size

pytestmark = pytest.mark.simulation

RUNS = size(3, 25)
SHARES = sampled([0.05, 0.1, 0.2], 2)


@pytest.mark.parametrize("share", SHARES)
@pytest.mark.parametrize("load", sampled([0.5, 0.9, 1.05, 1.5, 2.0, 3.0], 2))
def test_what_is_just_met_alone_does_not_fail(load: float, share: float) -> None:
    assert fails(load, share, stricter=1.0, runs=RUNS).waits <= 0.05


@pytest.mark.parametrize("share", SHARES)
@pytest.mark.parametrize("load", [1.5, 2.0, 3.0])
def test_an_overloaded_graph_fails(load: float, share: float) -> None:
    found = fails(load, share, stricter=1 / 3, runs=RUNS)
    assert found.waits == found.measured == 1.0
