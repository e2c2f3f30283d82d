"""Looks at a growing run, and failures that a fresh batch has to confirm."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy import stats

from nightly import size
from r2bspec.judge.statistics.rule_of_three import zero_failure_bound
from r2bspec.judge.statistics.t_interval import scatter_level
from r2bspec.plan.interim_looks import InterimLooks

pytestmark = pytest.mark.simulation


@pytest.mark.parametrize(("declared", "most"), [(5, 5), (10, 10), (20, 20), (5, 8), (5, 24)])
@pytest.mark.parametrize("differ", [0.01, 0.1, 0.2])
def test_looks_after_starts_keep_the_error_of_t(declared: int, most: int, differ: float) -> None:
    """Means of starts that differ by a share; before the declared starts, looks need room."""
    runs, looks = size(4000, 100_000), InterimLooks.planned(declared, declared, most)
    values = 1 + differ * np.random.default_rng(6).standard_normal((runs, most))
    wrong = np.zeros(runs, dtype=np.bool_)
    for look, end in enumerate(looks.iterations, start=1):
        seen = values[:, :end]
        level = scatter_level(looks.confidence_at(look))
        half = stats.t.ppf(level, end - 1) * seen.std(axis=1, ddof=1) / math.sqrt(end)
        upper = seen.mean(axis=1) + half
        if end < declared:
            upper *= 1 + zero_failure_bound(end, 0.95) / 5
        wrong |= upper < 1
    assert wrong.mean() <= 0.055 + 3 * (0.05 * 0.95 / runs) ** 0.5
