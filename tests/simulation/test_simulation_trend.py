"""How many change points of histories are found, and how many are false."""

from __future__ import annotations

import numpy as np
import pytest

from nightly import noise, size
from r2bspec.judge.statistics.change_points import Values, change_points

COMMITS = 100
RANDOM = np.random.default_rng(20261129)


def found(values: Values) -> list[int]:
    return [point.place for point in change_points(values)]


def stepped(place: int, until: int = COMMITS, by: float = 2.0) -> Values:
    values = RANDOM.normal(size=COMMITS)
    values[place:until] += by
    return values


def steady(kind: str) -> Values:
    chance = RANDOM.random(COMMITS)
    match kind:
        case "heavy tails":
            return RANDOM.standard_t(3, size=COMMITS)
        case "outliers":
            return RANDOM.normal(size=COMMITS) + 8 * (chance < 0.04)
        case "rare drops":
            return RANDOM.exponential(size=COMMITS) * (chance < 0.1)
        case "skewed":
            return np.exp(0.8 * RANDOM.normal(size=COMMITS))
    return RANDOM.normal(size=COMMITS)


def test_a_step_of_twice_the_scatter_is_found_within_five_commits() -> None:
    number = size(40, 300)
    places = [int(place) for place in RANDOM.integers(10, COMMITS - 9, number)]
    hits = sum(any(abs(one - place) <= 5 for one in found(stepped(place))) for place in places)
    assert hits >= (0.9 - noise(0.05)) * number


def test_a_step_is_found_soon_after_it() -> None:
    number = size(40, 300)
    hits = sum(any(abs(one - 85) <= 5 for one in found(stepped(85))) for _ in range(number))
    assert hits >= (0.9 - noise(0.1)) * number


def test_a_change_that_was_taken_back_is_found_with_both_of_its_ends() -> None:
    number = size(10, 200)
    hits = 0
    for _ in range(number):
        ends = found(stepped(45, until=55, by=3.0))
        hits += all(any(abs(one - end) <= 3 for one in ends) for end in (45, 55))
    assert hits >= (0.9 - noise(0.1)) * number


@pytest.mark.parametrize("kind", ["normal", "skewed", "heavy tails", "rare drops", "outliers"])
def test_few_steady_histories_of_five_metrics_have_a_change_point(kind: str) -> None:
    number = size(40, 1_000)
    false = sum(any(found(steady(kind)) for _ in range(5)) for _ in range(number))
    assert false <= (0.01 + noise(0.04)) * number
