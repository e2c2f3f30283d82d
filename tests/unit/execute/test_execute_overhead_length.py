"""How long the harness overhead is measured: until its median is known, within bounds."""

from __future__ import annotations

import math

import numpy as np
import pytest

from r2bspec.execute.measurement.harness_overhead import median_is_known, overhead_length


@pytest.mark.parametrize(
    ("usual", "fewest", "most"),
    [
        # 1 Hz and 10 Hz: a second has too few messages.
        (1, 11, 20),
        (10, 11, 20),
        # From 20 Hz on a second, of which nothing is left out while it has less than a p99 needs.
        (20, 20, 20),
        (100, 100, 100),
        (1000, 299, 1000),
        (5000, 299, 2000),
    ],
)
def test_the_length_depends_on_the_messages_of_a_second(usual: int, fewest: int, most: int) -> None:
    assert overhead_length(usual) == (fewest, most)


def test_as_many_are_needed_as_bound_the_p99_with_95_percent() -> None:
    fewest = overhead_length(1000).fewest
    assert 1 - 0.99**fewest >= 0.95 > 1 - 0.99 ** (fewest - 1)


def test_a_median_is_known_if_its_interval_is_narrow() -> None:
    # Of 11 values the interval is from the second smallest to the second largest.
    narrow = np.array([1, 80, 90, 95, 99, 100, 101, 105, 110, 125, 900])
    assert median_is_known(narrow)
    wide = narrow.copy()
    wide[-2] = 126
    assert not median_is_known(wide)
    wide = narrow.copy()
    wide[1] = 74
    assert not median_is_known(wide)


def test_few_values_have_no_interval() -> None:
    # The smallest and the largest of six values miss the median in 2 / 2**6 of cases: 3 %.
    assert not median_is_known(np.full(6, 100))
    assert not median_is_known(np.zeros(0))
    # Of seven in 1.6 %.
    assert median_is_known(np.full(7, 100))


def test_an_interval_misses_the_median_as_rarely_as_it_says() -> None:
    random = np.random.default_rng(1)
    runs, count, rank = 4000, 11, 2
    draws = np.sort(random.lognormal(0.0, 1.0, (runs, count)), axis=1)
    missed = np.mean((draws[:, rank - 1] > 1.0) | (draws[:, -rank] < 1.0))
    stated = 2 * sum(math.comb(count, below) for below in range(rank)) / 2**count
    assert stated <= 0.02
    assert missed == pytest.approx(stated, abs=0.006)
