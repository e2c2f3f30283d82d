"""Student's t: intervals of means, and of the ratios of runs.

Means over iterations
---------------------

With values v_1 .. v_m of m independent iterations, their mean v and standard deviation s,

    (v - mu) / (s / sqrt(m))

follows Student's t with m - 1 degrees of freedom, if the values are close to normal, which means
over seconds of messages are. One-sided bounds at the confidence c on the true mean mu are then
v -+ t_c s / sqrt(m).

Iterations in starts
--------------------

A run with several starts of the graph's processes has two sources of variation. Starts differ
(memory layout, order of discovery, placement of threads), and iterations of one start differ, too.
What varies from start to start is known from so many values as there are starts, however many
iterations each has: the interval is that of t over the means of the starts (Kalibera and Jones,
"Rigorous benchmarking in reasonable time", ISMM 2013, which has a level for each source). By chance
the means of few starts agree better than their iterations, so t over all iterations is worked out,
too, and the wider interval counts.

Pairs
-----

Base and head are measured in pairs on one host: the t test on the logarithms of the ratios.

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

Which side of a pair is first is decided by a coin for each pair (`pair_orders`). Whatever happens
to the first or the second run of a pair, to every third or every fourth run, or to all runs after a
moment, then falls on either side by chance alone, and chance is what the test accounts for. A fixed
order such as A B B A shares a linear drift exactly, but puts whatever returns with every fourth run
on one side: equal graphs then fail in half of the comparisons.

Two stored runs
---------------

Welch's t test on logarithms. Advisory, not for gating.

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
Interleaved pairs (`paired_ratio`) do not have these faults.
"""

from __future__ import annotations

import math
import random
import statistics
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, Literal, TypeVar

Value = TypeVar("Value")


def by_start(values: Sequence[Value], starts: Sequence[int]) -> list[list[Value]]:
    """Return the values of the iterations grouped by their start, in their order."""
    groups: dict[int, list[Value]] = {}
    for value, start in zip(values, starts, strict=True):
        groups.setdefault(start, []).append(value)
    return [*groups.values()]


_SCATTER_ERROR: Final = 0.8
_SCATTER_ERROR_OF_SHARES: Final = 0.4


def scatter_level(confidence: float, *, of_shares: bool = False) -> float:
    """Return the level of t quantiles for differences between a few starts or iterations.

    It compensates for what the plain tests ignore: starts that resemble each other a little,
    deviations that are not normal, and bad messages that are added where few were (`shares`). For a
    decision at 95 % it is 96 %; for a PASS of a share, which no margin of levels protects, 98 %
    (`tests/simulation/tables.py starts`).
    """
    return 1 - (1 - confidence) * (_SCATTER_ERROR_OF_SHARES if of_shares else _SCATTER_ERROR)


def t_quantile(freedom: float, confidence: float) -> float:
    """Return the quantile of Student's t."""
    from scipy.special import stdtrit

    return float(stdtrit(freedom, confidence))


def deviation_bound(deviation: float, number: int, confidence: float) -> float:
    """Return the upper bound of a standard deviation of normal values, by chi-square.

    Args:
        deviation: the deviation of the values.
        number: how many values, at least two.
        confidence: the confidence of the bound.
    """
    from scipy.special import chdtri

    return deviation * math.sqrt((number - 1) / float(chdtri(number - 1, confidence)))


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
) -> MeanInterval:
    """Return the mean of `values` with one-sided bounds on the true mean.

    Args:
        values: one for each iteration, at least two.
        confidence: the confidence of each bound by itself.
        resolution: the smallest difference that the clock can show in such a value. Values that
            agree exactly differ by less than that, not by nothing: the deviation is taken to be
            at least resolution / sqrt(12), that of a value rounded to it.

    Raises:
        ValueError: fewer than two values.
    """
    m = len(values)
    if m < 2:
        raise ValueError("an interval needs at least two values")
    mean = math.fsum(values) / m
    variance = math.fsum((value - mean) ** 2 for value in values) / (m - 1)
    deviation = max(math.sqrt(variance), resolution / math.sqrt(12))
    half = t_quantile(m - 1, confidence) * deviation / math.sqrt(m)
    return MeanInterval(mean=mean, lower=mean - half, upper=mean + half, deviation=deviation)


@dataclass(frozen=True)
class HierarchicalInterval:
    """The interval of a mean; `number` is that of the iterations or starts it counts."""

    interval: MeanInterval
    pieces: Literal["iterations", "starts"]
    number: int


def hierarchical_interval(
    values: Sequence[float], starts: Sequence[int], confidence: float, resolution: float = 0.0
) -> HierarchicalInterval:
    """Return the wider interval of starts and iterations.

    Args:
        values: one for each iteration, at least two, in the order of time.
        starts: the start of each iteration.
        confidence: the confidence of each bound by itself.
        resolution: the resolution of a value; see `mean_interval`.

    Raises:
        ValueError: fewer than two values.
    """
    interval = HierarchicalInterval(
        mean_interval(values, confidence, resolution), "iterations", len(values)
    )
    if len(set(starts)) < 2:
        return interval
    means = [statistics.fmean(group) for group in by_start(values, starts)]
    of_starts = mean_interval(means, confidence, resolution)
    if _width(of_starts) < _width(interval.interval):
        return interval
    return HierarchicalInterval(of_starts, "starts", len(means))


def _width(interval: MeanInterval) -> float:
    return interval.upper - interval.lower


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
        n: the number of pairs.
    """

    ratio: float
    lower: float
    upper: float
    deviation: float
    n: int

    @classmethod
    def of_logarithms(cls, found: MeanInterval, n: int) -> RatioInterval:
        """Return the interval from that of the logarithm of the ratio."""
        ratio, lower, upper = map(math.exp, (found.mean, found.lower, found.upper))
        return cls(ratio, lower, upper, found.deviation, n)


def _logarithms(values: Sequence[float]) -> list[float]:
    if any(value <= 0 or math.isinf(value) for value in values):
        raise ValueError("a ratio needs positive, finite values")
    return [math.log(value) for value in values]


def pair_orders(pairs: int, seed: int, session: int = 0) -> tuple[PairOrder, ...]:
    """Return the order of the two sides in each pair, by a coin; never the same order in all.

    Args:
        pairs: how many.
        seed: the seed of the coin; the same seed gives the same orders.
        session: which of the sessions of a comparison: 0 for the first pairs, 1 for those that
            confirm a failure.
    """
    coin = random.Random(f"{seed}/{session}")  # noqa: S311 - chance, not a secret
    while True:
        orders: tuple[PairOrder, ...] = tuple(
            "BA" if coin.getrandbits(1) else "AB" for _ in range(pairs)
        )
        if len(set(orders)) > 1 or pairs < 2:
            return orders


def paired_ratio(
    base: Sequence[float], head: Sequence[float], confidence: float, resolution: float = 0.0
) -> RatioInterval:
    """Return the ratio head / base of paired values with its one-sided bounds.

    Args:
        base: one positive value for each pair, at least two.
        head: the same for the head, in the order of the pairs.
        confidence: the confidence of each bound by itself.
        resolution: the smallest difference that the clock can show in such a value.

    Raises:
        ValueError: fewer than two pairs, unequal numbers, or a value that is not positive.
    """
    _logarithms((*base, *head))
    logs = [math.log(b / a) for a, b in zip(base, head, strict=True)]
    # Rounding both values to the resolution moves the logarithm by resolution / value of each.
    relative = math.sqrt(2) * resolution / min((*base, *head), default=1.0)
    return RatioInterval.of_logarithms(mean_interval(logs, confidence, relative), len(logs))


def welch_ratio(base: Sequence[float], head: Sequence[float], confidence: float) -> RatioInterval:
    """Return the ratio head / base of two runs with its one-sided bounds.

    Args:
        base: one positive value for each iteration of the base, at least two.
        head: the same for the head.
        confidence: the confidence of each bound by itself.

    Raises:
        ValueError: fewer than two values on a side, or a value that is not positive.
    """
    a, b = (mean_interval(_logarithms(values), confidence) for values in (base, head))
    square_a, square_b = a.deviation**2 / len(base), b.deviation**2 / len(head)
    square = square_a + square_b
    half = 0.0
    if square > 0:
        freedom = square**2 / (square_a**2 / (len(base) - 1) + square_b**2 / (len(head) - 1))
        half = t_quantile(freedom, confidence) * math.sqrt(square)
    ratio = b.mean - a.mean
    interval = MeanInterval(ratio, ratio - half, ratio + half, math.sqrt(square))
    return RatioInterval.of_logarithms(interval, min(len(base), len(head)))


def welch_ratio_of_runs(
    base: Sequence[float],
    head: Sequence[float],
    starts: tuple[Sequence[int], Sequence[int]],
    confidence: float,
) -> RatioInterval:
    """Return the ratio head / base of two runs: the wider interval of iterations and starts.

    Args:
        base: at least two positive values, one for each iteration.
        head: the same for the head.
        starts: of each iteration of the base, and of the head; empty where they are not known.
        confidence: the confidence of each bound by itself.

    Raises:
        ValueError: fewer than two values on a side, or a value that is not positive.
    """
    interval = welch_ratio(base, head, confidence)
    if not all(len(set(of)) > 1 for of in starts):
        return interval
    a, b = (
        [math.exp(statistics.fmean(map(math.log, group))) for group in by_start(values, of)]
        for values, of in zip((base, head), starts, strict=True)
    )
    of_starts = welch_ratio(a, b, confidence)
    is_wider = of_starts.upper / of_starts.lower >= interval.upper / interval.lower
    return of_starts if is_wider else interval
