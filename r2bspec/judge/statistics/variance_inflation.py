"""By how much correlation inflates the variance of a mean: Geyer's initial monotone sequence.

For a stationary sequence with the autocorrelations r_0 = 1, r_1, r_2, .. the variance of the mean
of many is larger than if they were independent by the factor

    F = -1 + 2 (r_0 + r_1 + r_2 + ..).

Of estimated autocorrelations the sum is mostly noise. The sums of pairs r_2j + r_2j+1 are positive
and fall with j (exactly so for reversible chains, about so for latencies), so they are added while
they are positive, each taken to be not above the one before.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def lagged_products(rows: NDArray[np.float64], lags: int) -> NDArray[np.float64]:
    """The sum over rows and i of v_i v_(i + lag), for each lag of 0..lags, by Fourier transform.

    Args:
        rows: shape (rows, longest), 0 behind the end of a shorter one.
        lags: the largest lag.
    """
    size = 1 << (rows.shape[1] + lags - 1).bit_length()
    transformed = np.fft.rfft(rows, size, axis=1)
    power = (transformed.real**2 + transformed.imag**2).sum(axis=0)
    return np.asarray(np.fft.irfft(power, size)[: lags + 1], dtype=np.float64)


def inflation(r: NDArray[np.float64]) -> float:
    """F from the autocorrelations r_0 = 1, r_1, ..; at least 1."""
    even = r.size - r.size % 2
    sums = r[0:even:2] + r[1:even:2]
    negative = np.flatnonzero(sums <= 0)
    kept = sums[: negative[0]] if negative.size else sums
    return max(1.0, -1 + 2 * float(np.minimum.accumulate(kept).sum())) if kept.size else 1.0
