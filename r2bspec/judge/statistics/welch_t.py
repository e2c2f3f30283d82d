"""Two stored runs: Welch's t test on logarithms. Advisory, not for gating.

With the logarithms of m_a and m_b iterations' values, their means, and variances s_a^2 and s_b^2,

    se^2 = s_a^2 / m_a + s_b^2 / m_b
    df   = se^4 / ((s_a^2 / m_a)^2 / (m_a - 1) + (s_b^2 / m_b)^2 / (m_b - 1))

one-sided bounds on the true ratio are exp(mean_b - mean_a -+ t_c(df) se). That is exact for
independent iterations, and iterations of one start are not: they share its placement in memory and
its processes. So where both runs have several starts, the same is worked out for the means of the
starts, and the wider interval counts (`welch_ratio_of_runs`).

Two runs with one start each differ by 2 to 3 % on a shared machine. The interval over their
iterations ignores that and shrinks as iterations are added, so that A compared with A looks worse
in a third of comparisons, and more often for longer runs. And no two stored runs share their hour.
Interleaved pairs (`paired_ratio`) or a history (`prediction_interval`) do not have these faults.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

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


@dataclass(frozen=True)
class RunValues:
    """The values of one run.

    Attributes:
        values: one positive value for each iteration.
        starts: the start of each; empty where it is not known.
    """

    values: Sequence[float]
    starts: Sequence[int] = ()

    def of_starts(self) -> list[float]:
        """The geometric mean of each start; nothing where starts are not known."""
        logs: dict[int, list[float]] = {}
        for value, start in zip(self.values, self.starts, strict=False):
            logs.setdefault(start, []).append(math.log(value))
        return [math.exp(math.fsum(each) / len(each)) for each in logs.values()]


def welch_ratio_of_runs(
    base: RunValues, head: RunValues, confidence: float
) -> tuple[RatioInterval, Literal["iterations", "starts"]]:
    """The ratio head / base of two runs, and of what the interval is.

    Args:
        base: at least two values.
        head: the same for the head.
        confidence: of each bound by itself.

    Raises:
        ValueError: fewer than two values on a side, or a value that is not positive.
    """
    found = welch_ratio(base.values, head.values, confidence)
    a, b = base.of_starts(), head.of_starts()
    if min(len(a), len(b)) < 2:
        return found, "iterations"
    by_start = welch_ratio(a, b, confidence)
    if by_start.upper / by_start.lower < found.upper / found.lower:
        return found, "iterations"
    return by_start, "starts"
