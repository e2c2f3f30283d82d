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
    # Of one start, iterations that resemble each other are a drift.
    most = 0.12 if name.startswith("iterations resemble") and shape.starts == 1 else 0.05
    assert share_found(STEADY[name], shape=shape, runs=RUNS) <= chance(most, RUNS)


@pytest.mark.parametrize(
    ("world", "change", "least"),
    [
        *(("starts differ by 2.7 %", change, 0.9) for change in CHANGES),
        # A slow first start, or a climb, may be one of starts that differ.
        *(
            (world, change, 0.9)
            for world in ("starts differ by 5 %", "starts differ by 10 %")
            for change in CHANGES
            if change not in {"first start 50 % slower", "climb of 30 % in the run"}
        ),
        ("each 50th message takes 9 times as long", "first iteration 50 % slower", 0.9),
        ("messages resemble (0.95)", "first 0.5 s of each iteration doubled", 0.9),
    ],
)
def test_a_part_that_differs(world: str, change: str, least: float) -> None:
    found = share_found(STEADY[world], CHANGES[change], runs=RUNS)
    assert found >= least - 3 * math.sqrt(least * (1 - least) / RUNS)
