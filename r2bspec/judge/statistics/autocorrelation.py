"""The effective sample size of a few values in the order of time.

Iterations follow one another on a machine that warms up, cools down, or is busy for a while: they
may be correlated. With the lag-1 autocorrelation r of m values, their mean scatters like that of
m / F independent ones,

    F = (1 + r) / (1 - r).

Of so few values the estimate r_1 is poor, and too low by (1 + 4 r) / m. Independent values have an
r_1 of -1 / m on average, with a standard error of 1 / sqrt(m). So only what exceeds that counts:

    r = r_1 + (1 + 4 r_1) / m,  at most 0.9,      if  r_1 + 1 / m > 1 / sqrt(m);    0 otherwise.

Fewer than five values do not show it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise

_MIN_VALUES = 5
_MAX_AUTOCORRELATION = 0.9


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
    if r_1 + 1 / m <= 1 / math.sqrt(m):
        return 1.0
    r = min(_MAX_AUTOCORRELATION, r_1 + (1 + 4 * r_1) / m)
    # Digits that the order of additions decides are cut off.
    return round((1 + r) / (1 - r), 6)
