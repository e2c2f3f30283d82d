"""The slope of a line through values with correlated residuals.

Least squares through n points (t_i, v_i) with residuals e_i. If the e_i were independent, the
standard error of the slope would be

    sqrt(sum e_i^2 / (n - 2) / sum (t_i - mean t)^2);

they are not, and it is larger by sqrt(F), with the variance inflation F of the residuals
(`r2bspec.judge.statistics.variance_inflation`). The effective sample size is n / F, so that t with
n / F - 2 degrees of freedom takes the place of the normal distribution. Residuals that wander
instead of scatter have an F of the order of n: such a line has no meaningful slope, and the error
shows it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from r2bspec.judge.statistics.variance_inflation import inflation, lagged_products

_LAG_DIVISOR = 3
_MIN_POINTS = 10


@dataclass(frozen=True)
class Trend:
    """A slope with its one-sided bounds; infinite where there are too few points."""

    slope: float
    lower: float
    upper: float


def trend(times: NDArray[np.float64], values: NDArray[np.float64], confidence: float) -> Trend:
    """The slope of `values` over `times` with one-sided bounds.

    Args:
        times: ascending, shape (n,).
        values: shape (n,).
        confidence: of each bound by itself.
    """
    n = times.size
    if n < _MIN_POINTS:
        return Trend(0.0, -math.inf, math.inf)
    from scipy.special import stdtrit

    t = times - times.mean()
    v = values - values.mean()
    spread = float(t @ t)
    slope = float(t @ v) / spread
    residuals = v - slope * t
    squares = float(residuals @ residuals)
    # No scatter beyond the last digits: the slope is exact.
    if squares <= n * (1e-12 * float(np.abs(values).max())) ** 2:
        return Trend(slope, slope, slope)
    products = lagged_products(residuals[np.newaxis], n // _LAG_DIVISOR)
    f = inflation(products / products[0])
    error = math.sqrt(squares / (n - 2) * f / spread)
    half = float(stdtrit(max(n / f - 2, 1.0), confidence)) * error
    return Trend(slope, slope - half, slope + half)
