"""The t interval for a mean over iterations.

With values v_1 .. v_m of m independent iterations, their mean v and standard deviation s,

    (v - mu) / (s / sqrt(m))

follows Student's t with m - 1 degrees of freedom, if the values are close to normal, which means
over seconds of messages are. One-sided bounds at the confidence c on the true mean mu are then
v -+ t_c s / sqrt(m). Where values resemble their neighbours in time, m / F takes the place of m,
and t has fewer degrees of freedom (`autocorrelation`).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from r2bspec.judge.statistics.autocorrelation import serial_degrees_of_freedom


@dataclass(frozen=True)
class MeanInterval:
    """A mean with its one-sided lower and upper bounds, each at the requested confidence."""

    mean: float
    lower: float
    upper: float
    deviation: float


def mean_interval(
    values: Sequence[float],
    confidence: float,
    resolution: float = 0.0,
    inflation: float = 1.0,
) -> MeanInterval:
    """The mean of `values` with one-sided bounds on the true mean.

    Args:
        values: one for each iteration, at least two.
        confidence: of each bound by itself.
        resolution: the smallest difference that the clock can show in such a value. Values that
            agree exactly differ by less than that, not by nothing: the deviation is taken to be
            at least resolution / sqrt(12), that of a value rounded to it.
        inflation: F, at least 1.

    Raises:
        ValueError: fewer than two values.
    """
    m = len(values)
    if m < 2:
        raise ValueError("an interval needs at least two values")
    from scipy.special import stdtrit

    mean = math.fsum(values) / m
    variance = math.fsum((value - mean) ** 2 for value in values) / (m - 1)
    deviation = max(math.sqrt(variance), resolution / math.sqrt(12))
    effective_n = m / inflation
    t = float(stdtrit(serial_degrees_of_freedom(m, inflation), confidence))
    half = t * deviation / math.sqrt(effective_n)
    return MeanInterval(mean=mean, lower=mean - half, upper=mean + half, deviation=deviation)


def iterations_to_settle(
    mean: float, deviation: float, limit: float, confidence: float, max_iterations: int
) -> int | None:
    """About how many iterations bring a bound past `limit`, if mean and deviation stay the same.

    The smallest m with t_c(m - 1) deviation / sqrt(m) < |mean - limit|. A forecast for the
    reader, and no part of a test.

    Returns:
        None if more than `max_iterations` are needed: the mean is too close to the limit.
    """
    from scipy.special import stdtrit

    for m in range(2, max_iterations + 1):
        if float(stdtrit(m - 1, confidence)) * deviation / math.sqrt(m) < abs(mean - limit):
            return m
    return None
