"""The statistics against SciPy, published tables and their own definitions."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from r2bspec.judge.statistics.autocorrelation import (
    lagged_products,
    serial_inflation,
    significant_inflation,
)
from r2bspec.judge.statistics.binomial import burst_tolerance, lower_bound, upper_bound
from r2bspec.judge.statistics.effective_sample_size import BadFlags, effective_sample
from r2bspec.judge.statistics.percentile_interval import RankedMessages, percentile_interval
from r2bspec.judge.statistics.rule_of_three import min_sample_size, zero_failure_bound
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

    @given(st.floats(1e-6, 0.999), st.sampled_from([0.9, CONFIDENCE, 0.99]))
    def test_it_is_the_smallest_number_that_is_enough(
        self, allowed: float, confidence: float
    ) -> None:
        needed = min_sample_size(allowed, confidence)
        assert needed is not None

        def doubt(number: int) -> float:
            return math.exp(number * math.log1p(-allowed))

        assert doubt(needed) <= (1 - confidence) * (1 + 1e-6)
        assert needed == 1 or doubt(needed - 1) > (1 - confidence) * (1 - 1e-6)

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

    def test_counts_need_not_be_whole(self) -> None:
        between = [upper_bound(k / 10, 500, 0.95) for k in range(21)]
        assert between == sorted(between)
        assert upper_bound(0.5, 333.3, 0.95) == pytest.approx(stats.beta.ppf(0.95, 1.5, 332.8))

    def test_bursts_that_a_pass_withstands(self) -> None:
        # 3,000 messages are worth 299 if bursts inflate the variance by 10: 2 L - 1 = 10.
        assert burst_tolerance(0, 3000, 0.01, 0.95) == pytest.approx(5.5, abs=0.05)
        assert burst_tolerance(0, 299, 0.01, 0.95) == pytest.approx(1.0, abs=0.01)
        assert burst_tolerance(0, 298, 0.01, 0.95) is None


class TestPercentileInterval:
    """The bounds in seconds decide exactly as the test on counts does."""

    @pytest.mark.parametrize("n", [10, 59, 300, 2000])
    @pytest.mark.parametrize("quantile", [0.5, 0.9, 0.99])
    def test_comparing_bounds_is_the_binomial_test(self, n: int, quantile: float) -> None:
        values = np.random.default_rng(n).exponential(size=n)
        ranked = RankedMessages([values])
        interval = percentile_interval(ranked, quantile, 0.95)
        allowed = 1 - quantile
        for limit in np.quantile(values, np.linspace(0, 1, 101)):
            worth = ranked.effective_sample(int(np.count_nonzero(values > limit)))
            upper = upper_bound(worth.bad_messages, worth.messages, 0.95)
            lower = lower_bound(worth.bad_messages, worth.messages, 0.95)
            if interval.upper <= limit:
                assert upper <= allowed + 1e-12
            if interval.lower > limit:
                assert lower > allowed - 1e-12

    def test_independent_messages_are_judged_as_independent(self) -> None:
        values = np.random.default_rng(3).permutation(np.arange(3000.0))
        interval = percentile_interval([values], 0.99, 0.95)
        # At most 20 may be over to pass, at least 40 must be to fail.
        assert (interval.lower, interval.estimate, interval.upper) == (2960, 2969, 2979)

    def test_too_few_messages_bound_nothing(self) -> None:
        def upper(n: int) -> float:
            return percentile_interval([np.arange(float(n))], 0.99, 0.95).upper

        assert upper(298) == np.inf
        assert upper(299) == 298

    def test_lost_messages_are_infinitely_late(self) -> None:
        values = np.random.default_rng(1).permutation([1.0] * 97 + [np.inf] * 3)
        interval = percentile_interval([values], 0.95, 0.95)
        assert (interval.estimate, interval.upper) == (1.0, np.inf)


class TestEffective:
    @staticmethod
    def flags(n: int, *bursts: tuple[int, int]) -> BadFlags:
        found = np.zeros(n, dtype=bool)
        for start, length in bursts:
            found[start : start + length] = True
        return found

    def test_single_ones_far_apart_count_in_full(self) -> None:
        found = effective_sample([self.flags(1000, (10, 1), (400, 1), (800, 1))])
        assert (found.n, found.bad, found.bursts, found.inflation) == (1000, 3, 3, 1.0)

    @pytest.mark.parametrize("share", [0, 1])
    def test_where_nothing_differs_there_is_nothing_to_estimate(self, share: int) -> None:
        assert effective_sample([np.full(100, bool(share))]).inflation == 1.0

    def test_bursts_count_as_far_fewer(self) -> None:
        found = effective_sample([self.flags(3000, (100, 5), (900, 5), (2000, 5))])
        assert (found.bursts, found.cause) == (3, "bursts")
        # Three bursts of five and the longest again: 20 / 3, so F is about 2 x 6.67 - 1.
        assert found.inflation == pytest.approx(12.3, abs=0.2)

    def test_stretches_are_seen_though_nothing_is_adjacent(self) -> None:
        flags = self.flags(3000)
        random = np.random.default_rng(4)
        for start in range(200, 3000, 400):
            flags[start + random.choice(60, 20, replace=False)] = True
        found = effective_sample([flags])
        assert found.cause == "clusters"
        assert found.inflation > 5

    def test_iterations_that_differ(self) -> None:
        pieces = [self.flags(300, (150, 1)) for _ in range(9)]
        worst = self.flags(300, *((at, 1) for at in range(0, 300, 10)))
        found = effective_sample([*pieces, worst])
        assert found.cause == "iterations"
        assert found.inflation > 10

    def test_nothing_spans_two_iterations(self) -> None:
        first, second = self.flags(300, (299, 1)), self.flags(300, (0, 1))
        assert effective_sample([first, second]).bursts == 2
        assert effective_sample([first, second]).inflation == 1.0
        assert effective_sample([np.concatenate((first, second))]).bursts == 1

    def test_no_iteration_and_empty_ones(self) -> None:
        assert effective_sample([]).n == 0
        assert effective_sample([self.flags(0), self.flags(10, (2, 1))]).n == 10


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

    def test_one_value_has_no_interval(self) -> None:
        with pytest.raises(ValueError, match="two values"):
            mean_interval([1.0], 0.95)


class TestSerial:
    @pytest.mark.parametrize("m", [3, 4, 5, 10, 100])
    def test_some_information_always_remains(self, m: int) -> None:
        assert serial_inflation([float(n) for n in range(m)]) <= m - 1 + 1e-6

    @pytest.mark.parametrize(
        "values", [[1.0, 2.0], [1.0] * 10, [1.0, -1.0] * 10, [3.0, 1.0, 2.0, 5.0, 1.0, 4.0]]
    )
    def test_what_chance_explains_costs_nothing(self, values: list[float]) -> None:
        assert serial_inflation(values) == 1.0

    def test_a_climb_is_worth_a_few_values_only(self) -> None:
        climb = [float(n) for n in range(20)]
        f = serial_inflation(climb)
        assert f == serial_inflation([1e3 * value + 7 for value in climb])
        assert 1.0 <= 20 / f < 2.0

    def test_the_known_correlation_is_found_in_many_values(self) -> None:
        noise = np.random.default_rng(1).standard_normal(20_000)
        values = [0.0]
        for each in noise.tolist():
            values.append(0.5 * values[-1] + each)
        assert serial_inflation(values) == pytest.approx(3.0, rel=0.1)

    def test_of_values_that_are_independent_by_design_only_what_is_significant_counts(self) -> None:
        random = np.random.default_rng(2)
        runs = [random.standard_normal(40).tolist() for _ in range(400)]
        unaffected = sum(significant_inflation(run) == 1.0 for run in runs)
        # One in six exceeds the standard error; the other estimate always adds to it.
        assert 0.78 * 400 <= unaffected <= 0.92 * 400
        assert all(significant_inflation(run) <= serial_inflation(run) for run in runs)

    def test_a_clear_correlation_counts_by_either_estimate(self) -> None:
        climb = [float(n) for n in range(40)]
        assert significant_inflation(climb) == pytest.approx(19.0)
        assert significant_inflation(climb[:4]) == 1.0
        assert significant_inflation([2.0] * 40) == 1.0

    def test_the_interval_is_that_of_so_many_values(self) -> None:
        values = [1.0, 2.0, 3.0, 4.0, 5.0, 6.0]
        plain, wide = mean_interval(values, 0.95), mean_interval(values, 0.95, inflation=2.0)
        freedom = (6 + 6 / 2) / 2 - 1
        half = stats.t.ppf(0.95, freedom) * plain.deviation / math.sqrt(6 / 2)
        assert wide.upper - wide.mean == pytest.approx(half)
        assert mean_interval([1.0, 2.0], 0.95, inflation=50.0).upper < math.inf


@pytest.mark.parametrize(("shape", "lags"), [((1, 5), 2), ((3, 500), 4), ((2, 3000), 200)])
def test_products_in_blocks_are_those_of_all_values(shape: tuple[int, int], lags: int) -> None:
    rows = np.random.default_rng(1).normal(size=shape)
    expected = [(rows[:, lag:] * rows[:, : shape[1] - lag]).sum() for lag in range(lags + 1)]
    assert lagged_products(rows, lags) == pytest.approx(expected, abs=1e-8)
