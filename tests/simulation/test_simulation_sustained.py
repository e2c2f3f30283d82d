"""`sustained` on queues close to their capacity.

The precision of a probe is 2 %: between 98 and 102 % of the capacity either answer is right.
"""

from __future__ import annotations

from collections import Counter

import pytest
from simulated_queues_near_capacity import Kind, probe

pytestmark = pytest.mark.simulation


def outcomes(kind: Kind, load: float, seconds: float, probes: int) -> Counter[str]:
    return Counter(probe(kind, load, seconds=seconds, seed=seed).outcome for seed in range(probes))


@pytest.mark.parametrize("load", [0.5, 0.8, 0.9, 0.95, 0.98])
def test_equal_times_are_clear_up_to_the_capacity(load: float) -> None:
    assert outcomes("D/D/1", load, 3, 2)["pass"] == 2


@pytest.mark.parametrize("load", [1.02, 1.05, 1.1, 1.5])
def test_and_beyond_it(load: float) -> None:
    assert outcomes("D/D/1", load, 3, 2)["fail"] == 2


@pytest.mark.parametrize("kind", ["D/M/1", "M/D/1", "M/M/1"])
def test_random_times_are_rarely_judged_wrongly(kind: Kind) -> None:
    for load in (0.8, 0.9, 0.95):
        found = outcomes(kind, load, 3, 60)
        assert found["fail"] <= 0.1 * (60 - found["invalid"])
    for load in (1.05, 1.1, 1.2):
        found = outcomes(kind, load, 3, 60)
        assert found["pass"] <= 0.05 * 60


def test_ten_seconds_show_that_random_times_are_kept_up_with() -> None:
    assert outcomes("D/M/1", 0.8, 10, 30)["pass"] >= 27
    assert outcomes("D/M/1", 1.2, 10, 30)["fail"] >= 27


def test_few_probes_are_stopped_early_for_the_wrong_reason() -> None:
    wrong = sum(
        found.stopped_early and found.holds != (load < 1)
        for load in (0.9, 0.95, 1.05, 1.1)
        for seed in range(50)
        if (found := probe("D/M/1", load, seconds=3, seed=seed))
    )
    assert wrong <= 4
