"""Searches of servers whose capacity is known: the bracket holds the truth, and says how sure.

The stated confidence is 95 %. Of n brackets a share of less than 0.95 - 3 sqrt(0.95 x 0.05 / n)
would be met by a search that keeps its promise once in 700 times.
"""

from __future__ import annotations

import math

import pytest

from nightly import size
from simulated_peaks import PRECISION, SERVERS, Searched, searched

pytestmark = pytest.mark.simulation

_SEARCHES = size(2, 60)
_LEAST = _SEARCHES * (0.95 - 3 * math.sqrt(0.95 * 0.05 / _SEARCHES))


def searches(world: str, about_hz: float, number: int = _SEARCHES) -> list[Searched]:
    return [searched(world, about_hz, seed) for seed in range(number)]


@pytest.mark.parametrize("about_hz", [20.0, 100.0, 400.0])
@pytest.mark.parametrize("world", [world for world in SERVERS if "D/D/1" in world])
def test_equal_times_are_found_to_the_precision(world: str, about_hz: float) -> None:
    for found in searches(world, about_hz, size(2, 8)):
        assert found.contains
        assert found.upper / found.lower <= 1 + PRECISION + 1e-9
        assert not found.record.open_hz


@pytest.mark.parametrize("about_hz", [20.0, 100.0, 400.0])
@pytest.mark.parametrize("world", [world for world in SERVERS if "D/D/1" not in world])
def test_random_times_are_bracketed_with_the_stated_confidence(world: str, about_hz: float) -> None:
    found = searches(world, about_hz)
    assert sum(each.contains for each in found) >= _LEAST
    # A bracket that is wider than was asked for says why.
    assert all(says_why(each) or each.upper / each.lower <= 1 + PRECISION + 1e-9 for each in found)


def says_why(found: Searched) -> bool:
    """Whether rates stayed open, nothing was proved, or the capacity is not known any better."""
    record, capacity = found.record, found.record.capacity
    if record.open_hz or record.proof == "open" or capacity is None or capacity.upper_hz is None:
        return True
    return capacity.upper_hz / capacity.lower_hz > 1 + PRECISION


def test_longer_probes_give_narrower_brackets() -> None:
    def width(seconds: float) -> float:
        found = [searched("D/M/1", 100.0, seed, seconds=seconds) for seed in range(size(4, 10))]
        return sorted(each.upper / max(each.lower, 0.01) for each in found)[len(found) // 2]

    assert width(40.0) < width(10.0)
