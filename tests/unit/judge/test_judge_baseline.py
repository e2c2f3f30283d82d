"""Ratios to a baseline, against SciPy and by their outcomes."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence

import numpy as np
import pytest
from scipy import stats

from r2bspec.judge.measure.metric_catalogue import Subjects, resolve
from r2bspec.judge.ratio_of_starts import judge_ratio
from r2bspec.judge.requirement_case import RequirementCase
from r2bspec.judge.statistics.t_interval import pair_orders, paired_ratio, welch_ratio
from r2bspec.judge.statistics.trend import trend
from r2bspec.language.comparison_grammar import parse_requirement

BASE = [100.0, 101.5, 98.7, 100.4, 99.1, 102.2]
HEAD = [95.2, 97.1, 93.0, 96.3, 94.4, 96.0]


def asked(text: str = "throughput.mean >= 97 % of baseline") -> RequirementCase:
    requirement = parse_requirement(text)
    assert requirement.bound is not None
    return RequirementCase(
        objective="no_regression",
        requirement=requirement,
        at_hz=30.0,
        info=resolve(requirement.metric, ("out",), Subjects(processes=("relay",)))[1],
        monitor="out",
        limit=requirement.bound.value,
    )


class TestStatistics:
    def test_the_paired_test_agrees_with_scipy(self) -> None:
        found = paired_ratio(BASE, HEAD, 0.95)
        logs = np.log(HEAD) - np.log(BASE)
        bounds = stats.t.interval(0.9, len(logs) - 1, loc=logs.mean(), scale=stats.sem(logs))
        assert (found.lower, found.upper) == pytest.approx(tuple(np.exp(bounds)))
        limit = found.upper
        p = stats.ttest_rel(np.log(HEAD), np.log(BASE) + math.log(limit), alternative="less").pvalue
        assert p == pytest.approx(0.05)

    def test_welch_agrees_with_scipy(self) -> None:
        found = welch_ratio(BASE, HEAD, 0.95)
        interval = stats.ttest_ind(np.log(HEAD), np.log(BASE), equal_var=False).confidence_interval(
            0.9
        )
        assert (found.lower, found.upper) == pytest.approx(
            (math.exp(interval.low), math.exp(interval.high))
        )

    def test_a_coin_decides_the_order_of_pairs(self) -> None:
        assert pair_orders(10, seed=7) == pair_orders(10, seed=7)
        assert pair_orders(10, seed=7) != pair_orders(10, seed=7, session=1)
        thrown = [pair_orders(6, seed=seed) for seed in range(400)]
        for pair in range(6):
            heads_first = sum(orders[pair] == "BA" for orders in thrown)
            assert 150 <= heads_first <= 250
        # Nothing that returns follows the coin: one throw is as often like the last as not.
        alike = sum(a == b for orders in thrown for a, b in itertools.pairwise(orders))
        assert 0.4 < alike / (5 * len(thrown)) < 0.6

    def test_a_trend_agrees_with_scipy_where_residuals_are_independent(self) -> None:
        random = np.random.default_rng(3)
        times = np.arange(300.0)
        values = 2 * times + random.standard_normal(300)
        found = trend(times, values, 0.95)
        expected = stats.linregress(times, values)
        assert found.slope == pytest.approx(expected.slope)
        assert found.upper - found.slope == pytest.approx(1.65 * expected.stderr, rel=0.3)

    def test_a_walk_has_no_slope_worth_stating(self) -> None:
        walk = np.cumsum(np.random.default_rng(4).standard_normal(1000))
        found = trend(np.arange(1000.0), walk, 0.95)
        assert found.lower < 0 < found.upper
        assert math.isinf(trend(np.arange(5.0), np.arange(5.0), 0.95).upper)
        assert math.isinf(trend(np.ones(50), np.arange(50.0), 0.95).upper)
        exact = trend(np.arange(50.0), 3 * np.arange(50.0), 0.95)
        assert (exact.lower, exact.upper) == pytest.approx((3.0, 3.0))


class TestOutcomes:
    @pytest.mark.parametrize(
        ("text", "outcome"),
        [
            ("throughput.mean >= 97 % of baseline", "fail"),
            ("throughput.mean >= 93 % of baseline", "pass"),
            ("throughput.mean >= 95.3 % of baseline", "inconclusive"),
            ("throughput.mean < 97 % of baseline", "pass"),
            ("throughput.mean <= 94 % of baseline", "fail"),
        ],
    )
    def test_the_margin_is_the_limit(self, text: str, outcome: str) -> None:
        found = judge_ratio(asked(text), BASE, HEAD)
        assert (found.outcome, found.method, found.n) == (outcome, "paired t on logs", 6)
        assert bool(found.remedy) == (outcome == "inconclusive")
        assert "of the baseline over 6 pairs" in found.reason

    @pytest.mark.parametrize("missing", [None, math.inf, 0.0])
    def test_a_head_without_a_value_fails_and_a_base_decides_nothing(
        self, missing: float | None
    ) -> None:
        broken: Sequence[float | None] = [*HEAD[:-1], missing]
        assert judge_ratio(asked(), BASE, broken).outcome == "fail"
        assert judge_ratio(asked(), broken, BASE).outcome == "inconclusive"
        assert judge_ratio(asked(), [], []).outcome == "inconclusive"

    def test_what_was_not_sampled_decides_nothing(self) -> None:
        sampled = asked("cpu.relay.mean <= 105 % of baseline")
        assert judge_ratio(sampled, BASE, [*HEAD[:-1], None]).outcome == "inconclusive"
        found = judge_ratio(sampled, BASE, [*HEAD[:-1], 0.0])
        assert found.outcome == "inconclusive"
        assert "a ratio to 0 is undefined" in found.reason

    def test_one_pair_is_too_few(self) -> None:
        assert "2 pairs" in judge_ratio(asked(), [1.0], [1.0]).remedy
