"""What intervals are made of, and whether what is advised to narrow them does."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from simulated_gates import Values
from simulated_starts import (
    ADVICE_WORLDS,
    DEFAULT,
    QUANTITIES,
    Shape,
    StartWorld,
    advised_shape,
    components,
    follow_advice,
    limit_of,
    verdict_on,
)

from nightly import noise, sampled, size
from r2bspec.judge.verdict import UncertaintyBudget

pytestmark = pytest.mark.simulation

RUNS = size(250, 1000)
BOTH = StartWorld(start=0.027, iteration=0.027, message_memory=0.9)


@pytest.mark.parametrize("shape", [Shape(), Shape(20, 3, 300)])
@pytest.mark.parametrize("name", [*ADVICE_WORLDS, "both, messages resemble (0.9)"])
def test_components_are_right_on_average(name: str, shape: Shape) -> None:
    world = ADVICE_WORLDS.get(name, BOTH)
    found = components(world, shape, runs=RUNS)
    # A part that is 0 in truth, and positive by chance, takes from that below it.
    bias = 0.1 if world.start else 0.3
    whole = found.truth.sum()
    for truth, mean, spread in zip(found.truth, found.mean, found.spread, strict=True):
        if truth > 0.2 * whole:
            assert abs(mean - truth) <= 4 * spread / np.sqrt(RUNS) + bias * truth
        else:
            # What is 0 in truth is positive in half of the runs, by what few starts scatter.
            apart = 2 / (shape.starts - 1) + 2 / (shape.pieces - shape.starts)
            assert mean <= truth + 0.5 * np.sqrt(apart) * whole


@pytest.mark.parametrize("number", [3, 5, 20])
def test_the_spread_is_that_of_so_many_starts(number: int) -> None:
    found = components(ADVICE_WORLDS["starts differ by 10 %"], Shape(number), runs=RUNS)
    assert found.spread[0] / found.mean[0] == pytest.approx(np.sqrt(2 / (number - 1)), rel=0.15)


def test_correlation_beyond_what_an_iteration_shows_is_a_part_of_iterations() -> None:
    found = components(StartWorld(message_memory=0.99), Shape(20, 3, 300), runs=200)
    assert found.mean[2] < 0.6 * found.truth[2]
    assert found.mean.sum() == pytest.approx(found.truth.sum(), rel=0.3)


def budget_of(values: Values, quantity: str, shape: Shape = DEFAULT) -> UncertaintyBudget:
    limit = 1.05 * limit_of(BOTH, quantity)
    found = verdict_on(values, quantity, limit, shape, start_s=12.0).requirements[0].budget
    assert found is not None
    return found


@pytest.mark.parametrize("quantity", QUANTITIES)
@pytest.mark.parametrize("name", ADVICE_WORLDS)
def test_parts_add_up_to_the_variance_of_the_interval(name: str, quantity: str) -> None:
    world, random = ADVICE_WORLDS[name], np.random.default_rng(4)
    budget = budget_of(world.run(random, DEFAULT), quantity)
    parts = [part for part in budget.parts if part.share is not None]
    assert sum(part.share or 0.0 for part in parts) == pytest.approx(1, abs=1e-5)
    square = sum((part.deviation or 0.0) ** 2 for part in parts)
    assert square == pytest.approx((budget.half_width / 1.6449) ** 2, rel=1e-3)


@pytest.mark.parametrize("quantity", ["p50", "mean, throughput"])
@pytest.mark.parametrize(
    ("world", "source"),
    [
        (StartWorld(start=0.05), "starts"),
        (StartWorld(iteration=0.05), "iterations"),
        (StartWorld(), "sampling"),
    ],
)
def test_the_largest_part_is_that_which_differs(
    world: StartWorld, source: str, quantity: str
) -> None:
    random, shape = np.random.default_rng(5), Shape(20, 3, 100)
    runs, right = size(10, 100), 0
    for _ in range(runs):
        budget = budget_of(world.run(random, shape), quantity, shape)
        shares = {part.source: part.share or 0.0 for part in budget.parts}
        del shares["allowance"]
        right += max(shares, key=shares.__getitem__) == source
    assert right >= 0.85 * runs


@pytest.mark.parametrize("quantity", sampled(["p50", "p99", "mean, throughput"], 2))
@pytest.mark.parametrize("name", ["nothing differs", "starts differ by 5 %"])
def test_what_halves_an_interval_halves_it(name: str, quantity: str) -> None:
    world, random = ADVICE_WORLDS[name], np.random.default_rng(6)
    ratios = []
    for _ in range(size(20, 100)):
        before = budget_of(world.run(random, DEFAULT), quantity)
        if shape := advised_shape(before.halve, DEFAULT):
            after = budget_of(world.run(random, shape), quantity, shape)
            ratios.append(after.half_width / before.half_width)
    assert len(ratios) >= 10
    assert 0.2 <= float(np.median(ratios)) <= 0.6 + noise(0.05)


@pytest.mark.parametrize(
    ("name", "start_s"), sampled(itertools.product(ADVICE_WORLDS, (2.0, 12.0)), 5)
)
def test_advice_decides_what_was_open(name: str, start_s: float) -> None:
    found = [
        follow_advice(ADVICE_WORLDS[name], quantity, runs=size(16, 200), start_s=start_s)
        for quantity in QUANTITIES
    ]
    open_, advised, decided = (
        sum(getattr(one, what) for one in found) for what in ("open", "advised", "decided")
    )
    assert decided >= (0.6 - noise(0.1)) * open_
    assert decided >= (0.72 - noise(0.12)) * advised
    if name.startswith("starts differ"):
        assert sum(one.starts for one in found) >= 0.9 * advised
