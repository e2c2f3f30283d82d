"""How often a part of a run is said to differ from the rest: seldom if it does not, else mostly."""

from __future__ import annotations

import math

import pytest
from simulated_gates import chance
from simulated_starts import Shape
from simulated_steadiness import CHANGES, PLAYED, STEADY, share_found

from nightly import size

pytestmark = pytest.mark.simulation

RUNS = size(60, 1000)


@pytest.mark.parametrize("shape", [PLAYED, Shape(1, 10, 75)])
@pytest.mark.parametrize("name", STEADY)
def test_steady_runs(name: str, shape: Shape) -> None:
    # Of one start, iterations that resemble each other are a climb.
    most = 0.12 if name.startswith("iterations resemble") and shape.starts == 1 else 0.05
    assert share_found(STEADY[name], shape=shape, runs=RUNS) <= chance(most, RUNS)


@pytest.mark.parametrize("shape", [Shape(2, 5, 75), Shape(5, 4, 75), Shape(1, 10, 75)])
@pytest.mark.parametrize("change", CHANGES)
def test_a_part_that_differs_is_found(change: str, shape: Shape) -> None:
    found = share_found(STEADY["starts differ by 5 %"], CHANGES[change], shape=shape, runs=RUNS)
    assert found >= 0.9 - 3 * math.sqrt(0.9 * 0.1 / RUNS)


def test_two_iterations_show_that_the_first_differs() -> None:
    change = CHANGES["first iteration of each start 50 % slower"]
    assert share_found(STEADY["starts differ by 10 %"], change, runs=RUNS) >= 0.9
