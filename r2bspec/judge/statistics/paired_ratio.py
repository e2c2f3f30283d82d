"""Base and head, measured in pairs on one host: the t test on the logarithms of the ratios.

Runs are interleaved (A the base, B the head), each in new processes, so that a machine that gets
slower slows both. Pair i has the values a_i and b_i of a metric, one iteration each, and

    d_i = ln(b_i / a_i),        mean d,  standard deviation s,  over n pairs.

A ratio of two noisy values is skewed; its logarithm is not, and 'half' and 'double' are equally
far from 1. (mean d - ln rho) / (s / sqrt(n)) follows Student's t with n - 1 degrees of freedom,
where rho is the true ratio, so that one-sided bounds on rho, each at the confidence c, are

    exp(mean d -+ t_c(n - 1) s / sqrt(n)).

The limit of the requirement is the margin: ``throughput.mean >= 97 % of baseline`` passes if the
lower bound on rho is at least 0.97, fails if the upper bound is below it. That is a test for
non-inferiority, not for a difference: given enough pairs any two graphs differ.

Which side of a pair is first is decided by a coin (`pair_orders`). Whatever happens to the first or
the second run of a pair, to every third or every fourth run, or to all runs after a moment, then
falls on either side by chance alone, and chance is what the test accounts for. A fixed order such
as A B B A shares a linear drift exactly, but puts whatever returns with every fourth run on one
side: equal graphs then fail in half of the comparisons. A coin that fell alike for all pairs is
thrown again, because a drift would then be a difference between the sides.
"""

from __future__ import annotations

import math
import random
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

from r2bspec.judge.statistics.t_interval import mean_interval

PairOrder = Literal["AB", "BA"]
"""Which side of a pair is played first; A is the base."""


@dataclass(frozen=True)
class RatioInterval:
    """A ratio with its one-sided bounds.

    Attributes:
        ratio: head over base.
        lower: of the true ratio, at the requested confidence.
        upper: the same, by itself.
        deviation: the standard deviation of the logarithms; 0.02 is about 2 %.
        n: the number of pairs, or of earlier runs.
    """

    ratio: float
    lower: float
    upper: float
    deviation: float
    n: int


def pair_orders(pairs: int, seed: int, session: int = 0) -> tuple[PairOrder, ...]:
    """The order of the two sides in each of so many pairs, by a coin.

    Args:
        pairs: how many; from two on, both orders occur.
        seed: of the coin; the same one gives the same orders.
        session: which of the sessions of a comparison: 0 for the first pairs, 1 for those that
            confirm a failure.
    """
    coin = random.Random(f"{seed}/{session}")  # noqa: S311 - chance, not a secret
    while True:
        heads_first = [bool(coin.getrandbits(1)) for _ in range(pairs)]
        if pairs < 2 or len(set(heads_first)) == 2:
            return tuple("BA" if first else "AB" for first in heads_first)


def paired_ratio(
    base: Sequence[float], head: Sequence[float], confidence: float, resolution: float = 0.0
) -> RatioInterval:
    """The ratio head / base of paired values with its one-sided bounds.

    Args:
        base: one positive value for each pair, at least two.
        head: the same for the head, in the order of the pairs.
        confidence: of each bound by itself.
        resolution: the smallest difference that the clock can show in such a value.

    Raises:
        ValueError: fewer than two pairs, unequal numbers, or a value that is not positive.
    """
    if any(value <= 0 or math.isinf(value) for value in (*base, *head)):
        raise ValueError("a ratio needs positive, finite values")
    logs = [math.log(b / a) for a, b in zip(base, head, strict=True)]
    # Rounding both values to the resolution moves the logarithm by resolution / value of each.
    relative = math.sqrt(2) * resolution / min((*base, *head), default=1.0)
    found = mean_interval(logs, confidence, relative)
    return RatioInterval(
        ratio=math.exp(found.mean),
        lower=math.exp(found.lower),
        upper=math.exp(found.upper),
        deviation=found.deviation,
        n=len(logs),
    )
