"""The effective sample size of a few values in the order of time.

Iterations follow one another on a machine that warms up, cools down, or is busy for a while: they
may be correlated, and so may the starts of a graph. With the lag-1 autocorrelation r of m values,
their mean scatters like that of m / F independent ones,

    F = (1 + r) / (1 - r).

Of so few values the estimate r_1 is poor, and too low by (1 + 4 r) / m (Kendall, "Note on bias in
the estimation of autocorrelation", Biometrika 41, 1954). Its standard error is about 1 / sqrt(m).
A test that corrects only for what is significant misses half of the correlation that matters, so
three quarters of a standard error are added:

    r = r_1 + (1 + 4 r_1) / m + 0.75 / sqrt(m),      at least 0 and at most 1 - 2 / m.

The upper end makes F at most m - 1: some information always remains. In simulation this keeps both
errors at about 5 % for r up to 0.5 and ten values (tests/simulation); the price is that
independent values give bounds that are wider by a fifth. Two values do not show it.

Student's t then has fewer degrees of freedom than m - 1. As F is itself uncertain, and large by
chance in some runs of independent values, they are (m + m / F) / 2 - 1, and at least 1.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise

_MIN_VALUES = 3
_STANDARD_ERRORS = 0.75


def serial_inflation(values: Sequence[float]) -> float:
    """F above, at least 1, of values in the order of time."""
    m = len(values)
    if m < _MIN_VALUES:
        return 1.0
    mean = math.fsum(values) / m
    deviations = [value - mean for value in values]
    squares = math.fsum(one * one for one in deviations)
    if not squares > 0:
        return 1.0
    r_1 = math.fsum(a * b for a, b in pairwise(deviations)) / squares
    r = min(r_1 + (1 + 4 * r_1) / m + _STANDARD_ERRORS / math.sqrt(m), 1 - 2 / m)
    # Digits that the order of additions decides are cut off.
    return round((1 + r) / (1 - r), 6) if r > 0 else 1.0


def serial_degrees_of_freedom(m: int, inflation: float) -> float:
    """The degrees of freedom of t for m values whose variance is inflated by F."""
    return max((m + m / inflation) / 2 - 1, 1.0)
