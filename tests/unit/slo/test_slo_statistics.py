"""The statistics against SciPy, published tables and their own definitions."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest
from scipy import stats

from r2bspec.slo.statistics.binomial import (
    least_to_fail,
    lower_bound,
    messages_to_settle,
    most_to_pass,
    upper_bound,
)
from r2bspec.slo.statistics.order import percentile_interval
from r2bspec.slo.statistics.student import iterations_to_settle, mean_interval
from r2bspec.slo.statistics.zero_failures import messages_needed, share_at_most

COUNTS = [(0, 1), (1, 1), (0, 298), (0, 299), (3, 10), (14, 3000), (60, 3000), (2999, 3000)]


class TestZeroFailures:
    @pytest.mark.parametrize(
        ("quantile", "confidence", "needed"),
        [
            (0.99, 0.95, 299),
            (0.99, 0.99, 459),
            (0.9, 0.99, 44),
            (0.9, 0.95, 29),
            (0.95, 0.95, 59),
            (0.999, 0.95, 2995),
            (0.5, 0.95, 5),
        ],
    )
    def test_published_numbers(self, quantile: float, confidence: float, needed: int) -> None:
        assert messages_needed(quantile, confidence) == needed

    def test_it_is_the_smallest_number_that_the_binomial_test_passes(self) -> None:
        for quantile in (0.5, 0.9, 0.99, 0.999):
            needed = messages_needed(quantile, 0.95)
            assert quantile**needed <= 0.05 * (1 + 1e-6)
            assert quantile ** (needed - 1) > 0.05

    def test_the_rule_of_three(self) -> None:
        assert share_at_most(1000, 0.95) == pytest.approx(3 / 1000, rel=0.01)
        assert share_at_most(300, 0.95) == pytest.approx(upper_bound(0, 300, 0.95))

    @pytest.mark.parametrize(("quantile", "confidence"), [(0, 0.95), (1, 0.95), (0.9, 1)])
    def test_nonsense_is_refused(self, quantile: float, confidence: float) -> None:
        with pytest.raises(ValueError, match="between"):
            messages_needed(quantile, confidence)
        with pytest.raises(ValueError, match="must be"):
            share_at_most(0, confidence)

    def test_no_scipy_is_needed(self) -> None:
        code = (
            "import sys; from r2bspec.slo.statistics.zero_failures import messages_needed;"
            "messages_needed(0.99, 0.95); sys.exit('scipy' in sys.modules)"
        )
        assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


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

    @pytest.mark.parametrize("n", [1, 5, 29, 298, 299, 300, 3000])
    @pytest.mark.parametrize("allowed", [0.5, 0.1, 0.01, 0.001])
    def test_critical_counts_are_those_of_the_test(self, n: int, allowed: float) -> None:
        passing = most_to_pass(n, allowed, 0.95)
        shows_less = [k for k in range(n + 1) if stats.binom.cdf(k, n, allowed) <= 0.05]
        assert passing == max(shows_less, default=None)
        failing = least_to_fail(n, allowed, 0.95)
        shows_more = [k for k in range(n + 1) if stats.binom.sf(k - 1, n, allowed) <= 0.05]
        assert failing == min(shows_more, default=None)

    def test_no_messages_show_nothing(self) -> None:
        assert most_to_pass(0, 0.1, 0.95) is None
        assert least_to_fail(0, 0.1, 0.95) is None

    def test_the_forecast_settles(self) -> None:
        n = messages_to_settle(0.005, 0.01, 0.95, most=10**6)
        assert n is not None
        assert upper_bound(round(n * 0.005), n, 0.95) <= 0.01
        assert messages_to_settle(0.01, 0.01, 0.95, most=10**5) is None


class TestPercentileInterval:
    """The bounds in seconds decide exactly as the test on counts does."""

    @pytest.mark.parametrize("n", [10, 59, 300, 2000])
    @pytest.mark.parametrize("quantile", [0.5, 0.9, 0.99])
    def test_comparing_bounds_is_the_binomial_test(self, n: int, quantile: float) -> None:
        values = np.random.default_rng(n).exponential(size=n)
        interval = percentile_interval(values, quantile, 0.95)
        allowed = 1 - quantile
        for limit in np.quantile(values, np.linspace(0, 1, 101)):
            over = int(np.count_nonzero(values > limit))
            assert (interval.upper <= limit) == (upper_bound(over, n, 0.95) <= allowed + 1e-12)
            assert (interval.lower > limit) == (lower_bound(over, n, 0.95) > allowed + 1e-12)

    def test_too_few_messages_bound_nothing(self) -> None:
        interval = percentile_interval(np.arange(298.0), 0.99, 0.95)
        assert interval.upper == np.inf
        assert percentile_interval(np.arange(299.0), 0.99, 0.95).upper == 298

    def test_lost_messages_are_infinitely_late(self) -> None:
        interval = percentile_interval(np.array([1.0] * 97 + [np.inf] * 3), 0.95, 0.95)
        assert (interval.estimate, interval.upper) == (1.0, np.inf)

    def test_coverage(self) -> None:
        rng = np.random.default_rng(5)
        true_p90 = stats.expon.ppf(0.9)
        bounds = [percentile_interval(rng.exponential(size=200), 0.9, 0.95) for _ in range(2000)]
        assert np.mean([bound.upper < true_p90 for bound in bounds]) < 0.06
        assert np.mean([bound.lower > true_p90 for bound in bounds]) < 0.06


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

    def test_the_forecast_settles(self) -> None:
        m = iterations_to_settle(1.0, 0.1, 1.05, 0.95, most=200)
        assert m is not None
        assert stats.t.ppf(0.95, m - 1) * 0.1 / np.sqrt(m) < 0.05
        assert stats.t.ppf(0.95, m - 2) * 0.1 / np.sqrt(m - 1) >= 0.05
        assert iterations_to_settle(1.0, 0.1, 1.0001, 0.95, most=200) is None
