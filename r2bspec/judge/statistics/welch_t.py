"""Two stored runs: Welch's t test on logarithms. It advises, and must not gate.

With the logarithms of m_a and m_b iterations' values, their means, and variances s_a^2 and s_b^2,

    se^2 = s_a^2 / m_a + s_b^2 / m_b
    df   = se^4 / ((s_a^2 / m_a)^2 / (m_a - 1) + (s_b^2 / m_b)^2 / (m_b - 1))

one-sided bounds on the true ratio are exp(mean_b - mean_a -+ t_c(df) se). That is exact for
iterations that were drawn independently, and iterations of one run are not: they share its
placement in memory, its processes and its hour. Two runs of one and the same graph differ by
2 to 3 % on a shared machine; the interval does not know of that and shrinks as iterations are
added, so that A against A looks worse in a third of comparisons, and the more often the longer
the runs are. Interleaved pairs (`paired`) or a history (`prediction`) do not have this fault.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from r2bspec.judge.statistics.paired_ratio import RatioInterval
from r2bspec.judge.statistics.t_interval import mean_interval


def welch_ratio(base: Sequence[float], head: Sequence[float], confidence: float) -> RatioInterval:
    """The ratio head / base of two runs with its one-sided bounds.

    Args:
        base: one positive value for each iteration of the base, at least two.
        head: the same for the head.
        confidence: of each bound by itself.

    Raises:
        ValueError: fewer than two values on a side, or a value that is not positive.
    """
    if any(value <= 0 or math.isinf(value) for value in (*base, *head)):
        raise ValueError("a ratio needs positive, finite values")
    from scipy.special import stdtrit

    a = mean_interval([math.log(value) for value in base], confidence)
    b = mean_interval([math.log(value) for value in head], confidence)
    square_a, square_b = a.deviation**2 / len(base), b.deviation**2 / len(head)
    square = square_a + square_b
    half = 0.0
    if square > 0:
        freedom = square**2 / (square_a**2 / (len(base) - 1) + square_b**2 / (len(head) - 1))
        half = float(stdtrit(freedom, confidence)) * math.sqrt(square)
    difference = b.mean - a.mean
    return RatioInterval(
        ratio=math.exp(difference),
        lower=math.exp(difference - half),
        upper=math.exp(difference + half),
        deviation=math.sqrt(square),
        n=min(len(base), len(head)),
    )
