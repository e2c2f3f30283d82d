"""The statistics against SciPy, published tables and their own definitions."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy import stats

from r2bspec.judge.statistics.binomial import lower_bound, upper_bound
from r2bspec.judge.statistics.more_pieces import mean_decides, more_pieces, share_decides
from r2bspec.judge.statistics.percentile_interval import RankedMessages, percentile_interval
from r2bspec.judge.statistics.rule_of_three import min_sample_size, zero_failure_bound
from r2bspec.judge.statistics.shares import ShareBounds, ShareLimit, bounds_of_flags
from r2bspec.judge.statistics.t_interval import mean_interval
from r2bspec.language.benchmark_defaults import CONFIDENCE

COUNTS = [(0, 1), (1, 1), (0, 298), (0, 299), (3, 10), (14, 3000), (60, 3000), (2999, 3000)]


class TestZeroFailures:
    @pytest.mark.parametrize(
        ("allowed", "confidence", "needed"),
        [
            (0.01, 0.95, 299),
            (0.01, 0.99, 459),
            (0.1, 0.99, 44),
            (0.1, 0.95, 29),
            (1 - 0.9, 0.95, 29),
            (0.05, 0.95, 59),
            (0.001, 0.95, 2995),
            (0.005, 0.95, 598),
            (0.5, 0.95, 5),
        ],
    )
    def test_published_numbers(self, allowed: float, confidence: float, needed: int) -> None:
        assert min_sample_size(allowed, confidence) == needed

    def test_no_number_shows_that_nothing_is_ever_lost(self) -> None:
        assert min_sample_size(0, CONFIDENCE) is None
        assert min_sample_size(0.01, 1.0) is None
        assert min_sample_size(1, CONFIDENCE) == 1

    def test_the_rule_of_three(self) -> None:
        assert zero_failure_bound(1000, 0.95) == pytest.approx(3 / 1000, rel=0.01)
        assert zero_failure_bound(300, 0.95) == pytest.approx(upper_bound(0, 300, 0.95))


class TestBinomial:
    @pytest.mark.parametrize(("k", "n"), COUNTS)
    @pytest.mark.parametrize("confidence", [0.9, 0.95, 0.99])
    def test_bounds_agree_with_scipy(self, k: int, n: int, confidence: float) -> None:
        for alternative, bound in (("less", upper_bound), ("greater", lower_bound)):
            interval = stats.binomtest(k, n, alternative=alternative).proportion_ci(
                confidence, method="exact"
            )
            expected = interval.high if alternative == "less" else interval.low
            assert bound(k, n, confidence) == pytest.approx(expected, rel=1e-9)

    @pytest.mark.parametrize(
        ("quantile", "needed"),
        [(0.99, (459, 662, 838, 1001, 1157)), (0.9, (44, 64, 81, 97, 113))],
    )
    def test_the_published_table_of_early_stopping(
        self, quantile: float, needed: tuple[int, ...]
    ) -> None:
        """MLPerf's rule: after so many queries, 0, 1, 2, .. may have been over the bound."""
        for over, n in enumerate(needed):
            assert upper_bound(over, n, 0.99) <= 1 - quantile + 1e-12
            assert upper_bound(over, n - 1, 0.99) > 1 - quantile


class TestPercentileInterval:
    """The bounds in seconds decide exactly as the test on counts does."""

    @pytest.mark.parametrize("n", [10, 59, 300, 2000])
    @pytest.mark.parametrize("quantile", [0.5, 0.9, 0.99])
    def test_comparing_bounds_is_the_test_on_counts(self, n: int, quantile: float) -> None:
        values = np.random.default_rng(n).exponential(size=n)
        test = share_limit(1 - quantile)
        ranked = RankedMessages([values], (), test)
        interval = percentile_interval(ranked, quantile)
        for limit in np.quantile(values, np.linspace(0, 1, 101)):
            found = ranked.over(int(np.count_nonzero(values > limit)))
            assert (interval.upper <= limit) == (found.upper <= test.allowed)
            assert (interval.lower > limit) == (found.lower > test.allowed)

    def test_independent_messages_are_judged_as_independent(self) -> None:
        # No stretch of 300 messages differs from the others.
        values = np.concatenate([np.arange(float(first), 3000, 10) for first in range(10)])
        interval = percentile_interval(RankedMessages([values], (), share_limit(0.01)), 0.99)
        # At most 20 may be over to pass, at least 40 must be to fail.
        assert (interval.lower, interval.estimate, interval.upper) == (2960, 2969, 2979)


def share_limit(allowed: float) -> ShareLimit:
    return ShareLimit(allowed, confidence=0.95, level=0.96)


def flags(*bad: int, n: int = 100) -> list[NDArray[np.bool_]]:
    """Iterations with so many bad messages each, far apart."""
    found = []
    for number in bad:
        piece = np.zeros(n, dtype=bool)
        piece[np.linspace(0, n - 1, number).astype(int) if number else []] = True
        found.append(piece)
    return found


STARTS = (1, 1, 2, 2, 3, 3, 4, 4, 5, 5)


def shared(*bad: int, n: int = 100, starts: tuple[int, ...] = STARTS) -> ShareBounds:
    """The bounds of a share of 1 % with so many bad messages in each iteration."""
    return bounds_of_flags(flags(*bad, n=n), starts, share_limit(0.01))


class TestShares:
    def test_a_burst_in_a_single_iteration_counts_by_stretches(self) -> None:
        late = np.zeros(3000, dtype=bool)
        late[500:505] = late[1500:1505] = True
        found = bounds_of_flags([late], (), share_limit(0.01))
        assert found.upper > 1.2 * upper_bound(10, 3000, 0.95)

    @given(st.permutations(range(5)), st.lists(st.integers(0, 9), min_size=10, max_size=10))
    def test_the_order_of_starts_does_not_count(self, order: list[int], bad: list[int]) -> None:
        moved = [bad[2 * start + place] for start in order for place in (0, 1)]
        assert shared(*moved) == shared(*bad)

    @given(
        st.lists(st.tuples(st.integers(0, 40), st.integers(0, 40)), min_size=2, max_size=10),
        st.integers(40, 400),
        st.sampled_from([0.005, 0.01, 0.1, 0.5]),
    )
    def test_fewer_bad_messages_give_no_worse_bound(
        self, counts: list[tuple[int, int]], n: int, allowed: float
    ) -> None:
        starts = tuple(1 + place // 2 for place in range(len(counts)))
        fewer, more = (
            bounds_of_flags(flags(*bad, n=n), starts, share_limit(allowed))
            for bad in (map(min, counts), map(max, counts))
        )
        assert fewer.upper <= more.upper
        assert fewer.lower <= more.lower


class TestMorePieces:
    def test_a_mean_needs_the_number_whose_interval_ends_at_the_limit(self) -> None:
        more = more_pieces(5, mean_decides(0.5, 1.0, 5, 0.95))
        assert more is not None

        def half(m: int) -> float:
            return float(stats.t.ppf(0.95, m - 1)) / math.sqrt(m)

        assert half(5 + more) / half(5) < 0.5 <= half(5 + more - 1) / half(5)

    def test_messages_without_a_late_one_need_what_the_rule_of_three_says(self) -> None:
        # 299 messages; 60 in each of five starts are 300.
        assert more_pieces(4, share_decides(0, 240, 0.01, 4, 0.95)) == 1
        assert more_pieces(4, share_decides(2.4, 240, 0.01, 4, 0.95)) is None


class TestMeanInterval:
    def test_it_agrees_with_scipy(self) -> None:
        values = [29.8, 30.1, 29.9, 30.0, 29.7]
        found = mean_interval(values, 0.95)
        expected = stats.t.interval(
            0.9, len(values) - 1, loc=np.mean(values), scale=stats.sem(values)
        )
        assert (found.lower, found.upper) == pytest.approx(expected)
        assert found.mean == pytest.approx(np.mean(values))

    def test_equal_values_differ_by_less_than_the_clock_shows(self) -> None:
        found = mean_interval([1.0, 1.0, 1.0], 0.95, resolution=0.01)
        assert 0.98 < found.lower < 1.0 < found.upper < 1.02
        assert mean_interval([1.0, 1.0], 0.95).lower == 1.0
