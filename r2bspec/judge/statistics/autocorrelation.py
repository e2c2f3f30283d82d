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

Where values are independent by design and F is only a precaution, as for long batches of the
messages of one play, that price is too high. `significant_inflation` counts only an r_1 that
exceeds its standard error:

    r = r_1 + (1 + 4 r_1) / m,     at most 0.9,      if  r_1 + 1 / m > 1 / sqrt(m);     0 otherwise.

Fewer than five values do not show that.

Student's t then has fewer degrees of freedom than m - 1. As F is itself uncertain, and large by
chance in some runs of independent values, they are (m + m / F) / 2 - 1, and at least 1.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise

_MIN_VALUES = 3
_STANDARD_ERRORS = 0.75

_MIN_SIGNIFICANT_VALUES = 5
_MAX_SIGNIFICANT = 0.9


def serial_inflation(values: Sequence[float]) -> float:
    """F above, at least 1, of values in the order of time."""
    m = len(values)
    r_1 = _lag_one(values)
    if m < _MIN_VALUES or r_1 is None:
        return 1.0
    return _factor(min(r_1 + (1 + 4 * r_1) / m + _STANDARD_ERRORS / math.sqrt(m), 1 - 2 / m))


def significant_inflation(values: Sequence[float]) -> float:
    """F above, at least 1, of values of which only a significant correlation counts."""
    m = len(values)
    r_1 = _lag_one(values)
    if m < _MIN_SIGNIFICANT_VALUES or r_1 is None or r_1 + 1 / m <= 1 / math.sqrt(m):
        return 1.0
    return _factor(min(r_1 + (1 + 4 * r_1) / m, _MAX_SIGNIFICANT))


def _lag_one(values: Sequence[float]) -> float | None:
    """The estimate r_1; None if the values are all the same."""
    mean = math.fsum(values) / max(len(values), 1)
    deviations = [value - mean for value in values]
    squares = math.fsum(one * one for one in deviations)
    if not squares > 0:
        return None
    return math.fsum(a * b for a, b in pairwise(deviations)) / squares


def _factor(r: float) -> float:
    # Digits that the order of additions decides are cut off.
    return round((1 + r) / (1 - r), 6) if r > 0 else 1.0


def serial_degrees_of_freedom(m: int, inflation: float) -> float:
    """The degrees of freedom of t for m values whose variance is inflated by F."""
    return max((m + m / inflation) / 2 - 1, 1.0)
