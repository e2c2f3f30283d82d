"""By how much correlation widens the interval of a mean, or of a slope.

Variance inflation
------------------

For a stationary sequence with the autocorrelations r_0 = 1, r_1, r_2, .. the variance of the mean
of many is larger than if they were independent by the factor

    F = -1 + 2 (r_0 + r_1 + r_2 + ..).

Of estimated autocorrelations the sum is mostly noise. The sums of pairs r_2j + r_2j+1 are positive
and fall with j (exactly so for reversible chains, about so for latencies), so they are added while
they are positive, each taken to be not above the one before.

A few values in the order of time
---------------------------------

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
from typing import Final

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray


def lagged_products(rows: NDArray[np.float64], lags: int) -> NDArray[np.float64]:
    """The sum over rows and i of v_i v_(i + lag), for each lag of 0..lags, by Fourier transform.

    Args:
        rows: shape (rows, longest), 0 behind the end of a shorter one.
        lags: the largest lag, of at least 1.
    """
    length = rows.shape[1]
    # Blocks of some lags stay in the cache of a processor, where a million values do not.
    size = min(1 << (length + lags - 1).bit_length(), 1 << (_BLOCK_LAGS * lags).bit_length())
    step = size - lags
    padded = np.zeros((rows.shape[0], -(-length // step) * step + lags))
    padded[:, :length] = rows
    blocks = sliding_window_view(padded, size, axis=1)[:, ::step].reshape(-1, size)
    products = np.zeros(size // 2 + 1, dtype=np.complex128)
    number = max(1, _VALUES // size)
    for first in range(0, len(blocks), number):
        followed = blocks[first : first + number]
        own = np.fft.rfft(followed[:, :step], size)
        products += (np.conj(own) * np.fft.rfft(followed)).sum(axis=0)
    return np.asarray(np.fft.irfft(products, size)[: lags + 1], dtype=np.float64)


_BLOCK_LAGS: Final = 8
_VALUES: Final = 1 << 17
"""Of all blocks that are transformed at once."""


def geyer_inflation(r: NDArray[np.float64]) -> float:
    """F from the autocorrelations r_0 = 1, r_1, ..; at least 1."""
    even = r.size - r.size % 2
    sums = r[0:even:2] + r[1:even:2]
    negative = np.flatnonzero(sums <= 0)
    kept = sums[: negative[0]] if negative.size else sums
    return max(1.0, -1 + 2 * float(np.minimum.accumulate(kept).sum())) if kept.size else 1.0


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
    squares = math.fsum(deviation * deviation for deviation in deviations)
    if not squares > 0:
        return None
    return math.fsum(a * b for a, b in pairwise(deviations)) / squares


def _factor(r: float) -> float:
    # Digits that the order of additions decides are cut off.
    return round((1 + r) / (1 - r), 6) if r > 0 else 1.0


def serial_degrees_of_freedom(m: int, inflation: float) -> float:
    """The degrees of freedom of t for m values whose variance is inflated by F."""
    return max((m + m / inflation) / 2 - 1, 1.0)


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
    """The line through `values` over `times`, both of shape (n,), n at least 1."""
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
    """The slope of `values` over `times` with one-sided bounds.

    Args:
        times: ascending, shape (n,).
        values: shape (n,).
        confidence: of each bound by itself.
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
    products = lagged_products(line.residuals[np.newaxis], n // _LAG_DIVISOR)
    f = geyer_inflation(products / products[0])
    error = math.sqrt(squares / (n - 2) * f / line.spread)
    half = float(stdtrit(max(n / f - 2, 1.0), confidence)) * error
    return Trend(slope, slope - half, slope + half)
