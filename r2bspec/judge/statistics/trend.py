"""A slope through points that resemble their neighbours, and the variance of a mean of such points.

Variance inflation
------------------

For a stationary sequence with the autocorrelations r_0 = 1, r_1, r_2, .. the variance of the mean
of many is larger than if they were independent by the factor

    F = -1 + 2 (r_0 + r_1 + r_2 + ..).

Of estimated autocorrelations the sum is mostly noise. The sums of pairs r_2j + r_2j+1 are positive
and fall with j (exactly so for reversible chains, about so for latencies), so they are added while
they are positive, each taken to be not above the sum before.

Of long batches of the messages of a play, which are independent by design, F is only a precaution:
`significant_inflation` counts a lag-1 autocorrelation, without its bias (Kendall, "Note on bias in
the estimation of autocorrelation", Biometrika 41, 1954), only if it exceeds its standard error:

    F = (1 + r) / (1 - r),  r = r_1 + (1 + 4 r_1) / m, at most 0.9,  if  r_1 + 1 / m > 1 / sqrt(m).

Fewer than five values do not show that.

Slopes
------

Least squares through n points (t_i, v_i) with residuals e_i. If the e_i were independent, the
standard error of the slope would be

    sqrt(sum e_i^2 / (n - 2) / sum (t_i - mean t)^2);

they are not, and it is larger by sqrt(F), with the variance inflation F of the residuals
(`geyer_inflation`). The effective sample size is n / F, so that t with
n / F - 2 degrees of freedom takes the place of the normal distribution. Residuals that wander
instead of scatter have an F of the order of n: such a line has no meaningful slope, and the error
shows it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray


def lagged_products(values: NDArray[np.float64], lags: int) -> NDArray[np.float64]:
    """Return the sum over i of v_i v_(i + lag), for each lag of 0..lags, by Fourier transform.

    Args:
        values: shape (n,).
        lags: the largest lag.
    """
    size = 1 << (values.size + lags - 1).bit_length()
    spectrum = np.fft.rfft(values, size)
    products = np.fft.irfft(np.abs(spectrum) ** 2, size)
    return np.asarray(products[: lags + 1], dtype=np.float64)


def geyer_inflation(r: NDArray[np.float64]) -> float:
    """Return F from the autocorrelations r_0 = 1, r_1, ..; at least 1."""
    even = r.size - r.size % 2
    sums = r[0:even:2] + r[1:even:2]
    negative = np.flatnonzero(sums <= 0)
    kept = sums[: negative[0]] if negative.size else sums
    return max(1.0, -1 + 2 * float(np.minimum.accumulate(kept).sum())) if kept.size else 1.0


_MIN_SIGNIFICANT_VALUES = 5
_MAX_SIGNIFICANT = 0.9


def significant_inflation(values: Sequence[float]) -> float:
    """Return F above, at least 1, where only a significant correlation counts."""
    m = len(values)
    mean = math.fsum(values) / max(m, 1)
    deviations = [value - mean for value in values]
    squares = math.fsum(deviation * deviation for deviation in deviations)
    if m < _MIN_SIGNIFICANT_VALUES or not squares > 0:
        return 1.0
    r_1 = math.fsum(a * b for a, b in pairwise(deviations)) / squares
    if r_1 + 1 / m <= 1 / math.sqrt(m):
        return 1.0
    r = min(r_1 + (1 + 4 * r_1) / m, _MAX_SIGNIFICANT)
    # Digits that the order of additions decides are cut off.
    return round((1 + r) / (1 - r), 6) if r > 0 else 1.0


_LAG_DIVISOR = 3
_MIN_POINTS = 10


@dataclass(frozen=True)
class Line:
    """A line by least squares through points (t_i, v_i).

    Attributes:
        slope: 0 where all t_i are the same.
        spread: sum (t_i - mean t)^2.
        residuals: e_i.
    """

    slope: float
    spread: float
    residuals: NDArray[np.float64]


def least_squares(times: NDArray[np.float64], values: NDArray[np.float64]) -> Line:
    """Return the line through `values` over `times`, both of shape (n,), n at least 1."""
    t, v = times - times.mean(), values - values.mean()
    spread = float(t @ t)
    slope = float(t @ v) / spread if spread > 0 else 0.0
    return Line(slope, spread, v - slope * t)


@dataclass(frozen=True)
class Trend:
    """A slope with its one-sided bounds; infinite where there are too few points."""

    slope: float
    lower: float
    upper: float


def trend(times: NDArray[np.float64], values: NDArray[np.float64], confidence: float) -> Trend:
    """Return the slope of `values` over `times` with one-sided bounds.

    Args:
        times: ascending, shape (n,).
        values: shape (n,).
        confidence: the confidence of each bound by itself.
    """
    n = times.size
    if n < _MIN_POINTS or times.min() == times.max():
        return Trend(0.0, -math.inf, math.inf)
    from scipy.special import stdtrit

    line = least_squares(times, values)
    slope, squares = line.slope, float(line.residuals @ line.residuals)
    # No scatter beyond the last digits: the slope is exact.
    if squares <= n * (1e-12 * float(np.abs(values).max())) ** 2:
        return Trend(slope, slope, slope)
    products = lagged_products(line.residuals, n // _LAG_DIVISOR)
    f = geyer_inflation(products / products[0])
    error = math.sqrt(squares / (n - 2) * f / line.spread)
    half = float(stdtrit(max(n / f - 2, 1.0), confidence)) * error
    return Trend(slope, slope - half, slope + half)
