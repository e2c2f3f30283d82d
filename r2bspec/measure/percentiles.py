"""Percentiles that are observed values."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray


def percentile(values: NDArray[np.float64], q: float, lost: int = 0) -> float | None:
    """The value at or below which a fraction `q` of all messages lies.

    Nearest rank, which is the inverse of the empirical distribution function: with the n values
    in ascending order, followed by `lost` times infinity, it is the k-th, where

        k = max(1, ceil(q (n + lost)))

    It is always an observed value, never an interpolated one.

    Args:
        values: shape (n,), in any order, finite.
        q: 0 < q <= 1.
        lost: messages that never arrived; they count as later than every other.

    Returns:
        None if there are no messages; infinity if the k-th was lost.
    """
    total = values.size + lost
    if total == 0:
        return None
    k = rank(q, total)
    if k > values.size:
        return math.inf
    return float(np.partition(values, k - 1)[k - 1])


def rank(q: float, n: int) -> int:
    """The smallest k of 1..n with k / n >= q, without rounding errors.

    0.07 x 100 is 7.000000000000001 in binary floating point; the tolerance keeps it 7.
    """
    return min(n, max(1, math.ceil(q * n - 1e-9 * n)))
