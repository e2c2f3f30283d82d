"""The noise floor of a comparison, and the smallest regression it can detect.

`calibrate` runs a graph against itself. The logarithms d_i of the ratios of such A/A pairs have
the standard deviation s, the noise floor: by so much two iterations of the same graph differ. If
the true ratio lies beyond the limit by the factor exp(delta), the t statistic of n pairs follows
the noncentral t distribution with n - 1 degrees of freedom and noncentrality

    lambda = delta sqrt(n) / s

and the test at the confidence c decides with probability P(T > t_c(n - 1)). Let lambda* be the
lambda for which that is the required power. Then

    delta* = lambda* s / sqrt(n)

is both the smallest regression beyond the limit that fails with that power, and the smallest
margin with which a graph that has not changed passes with that power. A smaller margin cannot be
gated on this machine.

s is itself an estimate from m pairs. `noise_floor` gives its upper confidence bound,

    s sqrt((m - 1) / chi2),    chi2 the 1 - c quantile with m - 1 degrees of freedom,

because a margin that is a little too wide costs less than false alarms.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from r2bspec.judge.statistics.t_interval import mean_interval

DEFAULT_POWER = 0.9
"""Nine of ten runs of a changed graph are detected."""


@dataclass(frozen=True)
class NoiseFloor:
    """By how much equal iterations differ: the standard deviation of the logarithms.

    Attributes:
        deviation: estimated from `n` A/A pairs.
        upper: its upper confidence bound.
        bias: the mean of the logarithms; of A against A it should be 0 within its error.
        biased: whether it is not, at the requested confidence each way.
    """

    deviation: float
    upper: float
    bias: float
    biased: bool
    n: int


def noise_floor(ratios: Sequence[float], confidence: float) -> NoiseFloor:
    """The noise floor from the ratios of A/A pairs.

    Args:
        ratios: second over first value of each pair, positive, at least two.
        confidence: of the bound.

    Raises:
        ValueError: fewer than two ratios, or one that is not positive.
    """
    if any(ratio <= 0 for ratio in ratios):
        raise ValueError("a ratio is positive")
    from scipy.special import gammaincinv

    logs = [math.log(ratio) for ratio in ratios]
    found = mean_interval(logs, confidence)
    freedom = len(logs) - 1
    # The chi-squared quantile is twice that of the gamma distribution with half the freedom.
    quantile = 2 * float(gammaincinv(freedom / 2, 1 - confidence))
    return NoiseFloor(
        deviation=found.deviation,
        upper=found.deviation * math.sqrt(freedom / quantile),
        bias=found.mean,
        biased=found.lower > 0 or found.upper < 0,
        n=len(logs),
    )


def power_of_pairs(delta: float, deviation: float, n: int, confidence: float) -> float:
    """The probability that n pairs decide, if the truth is `delta` beyond the limit.

    Args:
        delta: logarithm of the true ratio over the limit, on the side that decides, positive.
        deviation: the noise floor s, positive.
        n: pairs, at least two.
        confidence: of the test.
    """
    from scipy.special import nctdtr, stdtrit

    limit = float(stdtrit(n - 1, confidence))
    return 1 - float(nctdtr(n - 1, delta * math.sqrt(n) / deviation, limit))


def smallest_detectable(
    deviation: float, n: int, confidence: float, power: float = DEFAULT_POWER
) -> float:
    """The delta* of the module's text: a logarithm, so that 0.03 is about 3 %.

    Args:
        deviation: the noise floor s.
        n: pairs, at least two.
        confidence: of the test.
        power: of the decision.
    """
    if deviation <= 0:
        return 0.0
    low, high = 0.0, deviation
    while power_of_pairs(high, deviation, n, confidence) < power:
        low, high = high, 2 * high
    while high - low > 1e-6 * high:
        middle = (low + high) / 2
        if power_of_pairs(middle, deviation, n, confidence) < power:
            low = middle
        else:
            high = middle
    return high


def pairs_needed(
    delta: float,
    deviation: float,
    confidence: float,
    power: float = DEFAULT_POWER,
    max_pairs: int = 1000,
) -> int | None:
    """The smallest number of pairs that decides with the given power; None if over `max_pairs`."""
    for n in range(2, max_pairs + 1):
        if power_of_pairs(delta, deviation, n, confidence) >= power:
            return n
    return None
