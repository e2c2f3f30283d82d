"""Change points: what is one, and what is none."""

from __future__ import annotations

import numpy as np
import pytest

from r2bspec.judge.statistics.change_points import change_points

NOISE = np.random.default_rng(7).normal(10, 0.1, 40)


def test_a_change_point_is_the_first_value_after_a_step() -> None:
    values = NOISE + np.where(np.arange(40) >= 25, 1.0, 0.0)
    (point,) = change_points(values)
    assert point.place == 25
    assert (point.before, point.after) == pytest.approx((10, 11), abs=0.1)
    assert point.error < 0.0005


def test_a_short_history_shows_a_clear_step() -> None:
    values = np.array([10.0, 10.1, 9.9, 10.2, 12.0, 12.1, 11.9, 12.2])
    assert [point.place for point in change_points(values)] == [4]


@pytest.mark.parametrize(
    "values",
    [
        [],
        [1.0],
        [1.0] * 5,
        [3.0] * 60,
        [*NOISE[:20], 15.0, *NOISE[20:]],
        [*NOISE, 15.0],
        [*[0.0] * 30, 0.2, *[0.0] * 30],
        [*[0.0] * 30, 0.2],
    ],
    ids=["none", "one", "five", "equal", "outlier", "last outlier", "one drop", "last drop"],
)
def test_a_single_other_value_is_no_change(values: list[float]) -> None:
    assert change_points(np.array(values)) == []


def test_a_step_between_constant_values_is_found() -> None:
    assert [point.place for point in change_points(np.repeat([30.0, 25.0], 15))] == [15]
