"""Confidence bounds on a percentile from order statistics: the binomial test, read in seconds.

Whether a percentile q lies below a limit is the question whether at most a share 1 - q of all
messages is over it. With the critical counts of the binomial test for n messages and 1 - q

    k_pass = the most messages over the limit that still show q below it
    k_fail = the fewest messages over the limit that show q above it

the test passes exactly if the (k_pass + 1)-th largest message is within the limit, and fails
exactly if the k_fail-th largest is over it. So these two messages are the upper and the lower
confidence bound on the percentile: comparing them with the limit is the test itself.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from r2bspec.measure.percentiles import rank
from r2bspec.slo.statistics.binomial import least_to_fail, most_to_pass


@dataclass(frozen=True)
class PercentileInterval:
    """A percentile with its one-sided bounds; infinite where the messages do not bound it."""

    estimate: float
    lower: float
    upper: float


def allowed_share(q: float) -> float:
    """1 - q, without the digits that binary floating point adds to it: 0.01 for 0.99."""
    return round(1 - q, 12)


def percentile_interval(
    values: NDArray[np.float64], q: float, confidence: float
) -> PercentileInterval:
    """The percentile `q` of `values` and its one-sided bounds, each at `confidence`.

    Args:
        values: shape (n,), n >= 1, in any order; messages that were lost are +inf, or -inf where
            being late is what is asked for.
        q: 0 < q < 1.
        confidence: of each bound by itself.
    """
    ordered = np.sort(values)
    n = ordered.size
    passing = most_to_pass(n, allowed_share(q), confidence)
    failing = least_to_fail(n, allowed_share(q), confidence)
    return PercentileInterval(
        estimate=float(ordered[rank(q, n) - 1]),
        lower=-math.inf if failing is None else float(ordered[n - failing]),
        upper=math.inf if passing is None else float(ordered[n - 1 - passing]),
    )
