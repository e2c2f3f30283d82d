"""Confidence bounds on a percentile, from order statistics and from levels.

Order statistics
----------------

Whether a percentile q lies below a limit is the question whether at most a share 1 - q of all
messages is over it. If exactly the k largest messages are over the limit, the bounds on that share
(`r2bspec.judge.statistics.shares`) say 'pass', 'fail' or neither, and more bad messages never give
a better answer. So the requirement passes exactly if the (k + 1)-th largest message is within the
limit, with the largest k that passes, and fails exactly if the k-th largest is over it, with the
smallest k that fails: these two messages are the upper and the lower bound on the percentile, and
comparing them with the limit is the test itself.

Levels
------

Of a p99 each iteration has a few bad messages, hardly enough to see that iterations differ. The
bulk of the messages shows that better: what makes an iteration or a start slower as a whole moves
its middle, too.

The level of an iteration (or start) is the mean of the middle half of its values. With the standard
deviation s of m levels and t at the level l, the percentile q of all messages is open by at
least

    h = t_l s sqrt(1 / m + z^2 s^2 / (s^2 + e^2) / (2 (m - 1))).

The first part is the interval of a mean over m values. The second is for a percentile of a mixture,
which lies z = |Phi^-1(q)| standard deviations sqrt(s^2 + e^2) from its middle, where e (1.4826
times the median absolute deviation from the level) is that of the messages of one iteration: s has
a standard error of s / sqrt(2 (m - 1)).

Few levels show far too small an s as easily as a slightly too large s, and then the tail of the
mixture is too near. So on the side of its tail a percentile is open by at least

    sqrt(t_l^2 s^2 / m + z^2 (sqrt(u^2 + e^2) - sqrt(s^2 + e^2))^2),     u^2 = (m - 1) s^2 / chi2,

with chi2 the 1 - l quantile of m - 1 degrees of freedom: u is the upper bound of the deviation, and
the parts are added as in Graybill and Wang, "Confidence intervals on nonnegative linear
combinations of variances", JASA 75, 1980. Of starts and iterations the wider margin counts.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from r2bspec.judge.measure.times import rank
from r2bspec.judge.statistics.binomial import last_true
from r2bspec.judge.statistics.shares import (
    ShareBounds,
    ShareLimit,
    pieces_of_levels,
    share_bounds,
    sizes_of,
)
from r2bspec.judge.statistics.t_interval import by_start, deviation_bound, t_quantile

_MAD_TO_DEVIATION = 1.4826
_MIN_LEVELS = 2


@dataclass(frozen=True)
class LevelMargin:
    """By how much a percentile is open because levels differ.

    Attributes:
        half: h above, in the unit of the values.
        tail: the same on the side of the percentile's tail.
        deviation: the standard deviation s of the levels.
        number: m.
        pieces: what has these levels.
    """

    half: float
    tail: float
    deviation: float
    number: int
    pieces: Literal["iterations", "starts"]


@dataclass(frozen=True)
class PercentileInterval:
    """A percentile with its one-sided bounds; infinite where the messages do not bound it.

    Attributes:
        levels: by how much the levels of iterations or starts leave it open, where there are
            several.
    """

    estimate: float
    lower: float
    upper: float
    levels: LevelMargin | None = None


def allowed_share(q: float) -> float:
    """Return 1 - q without the digits that binary floating point adds to it: 0.01 for 0.99."""
    return round(1 - q, 12)


class RankedMessages:
    """The messages of some iterations in the order of size.

    Attributes:
        n: how many there are.
        ordered: all of them, ascending; shape (n,).
    """

    def __init__(
        self, values: Sequence[NDArray[np.float64]], starts: Sequence[int], test: ShareLimit
    ) -> None:
        """Take an array for each iteration; lost messages are +inf, or -inf for a lower limit.

        Args:
            values: in the order they were played.
            starts: the start of each iteration; empty where all belong to the same start.
            test: the test of the share that may be over the limit.
        """
        self.values, self.starts, self.test = values, starts, test
        self.ordered = np.sort(np.concatenate([*values, np.empty(0)]))
        self.n = int(self.ordered.size)
        pieces = pieces_of_levels(values, starts)
        self._sorted = {differ: [np.sort(row) for row in rows] for differ, rows in pieces.items()}
        self._sizes = sizes_of(pieces)
        self._bounds: dict[int, ShareBounds] = {}

    def over(self, k: int) -> ShareBounds:
        """Return the bounds on the share over a limit if the k largest messages are over it."""
        if k not in self._bounds:
            least = self.ordered[self.n - k] if k else math.nan
            counts = {
                differ: np.array([row.size - np.searchsorted(row, least) for row in rows])
                for differ, rows in self._sorted.items()
            }
            self._bounds[k] = share_bounds(counts, self._sizes, self.test)
        return self._bounds[k]

    def max_passing(self) -> int | None:
        """Return the largest k that passes; None if not even 0 does."""

        def passes(k: int) -> bool:
            return self.over(k).upper <= self.test.allowed

        return last_true(passes, 0, self.n) if passes(0) else None

    def min_failing(self) -> int | None:
        """Return the smallest k that fails; None if not even n does."""

        def is_open(k: int) -> bool:
            return self.over(k).lower <= self.test.allowed

        if is_open(self.n):
            return None
        return last_true(is_open, 0, self.n) + 1


def percentile_interval(ranked: RankedMessages, q: float) -> PercentileInterval:
    """Return the percentile `q` of all messages, at least one, and its one-sided bounds."""
    n, ordered = ranked.n, ranked.ordered
    passing, failing = ranked.max_passing(), ranked.min_failing()
    estimate = float(ordered[rank(q, n) - 1])
    levels = level_margin(ranked.values, ranked.starts, q, ranked.test.level)
    below, above = (levels.half, levels.tail) if levels is not None else (0.0, 0.0)
    if q < 0.5:
        below, above = above, below
    lower = -math.inf if failing is None else float(ordered[n - failing])
    upper = math.inf if passing is None or passing >= n else float(ordered[n - 1 - passing])
    # No time is shorter than nothing, however much levels differ.
    finite = ordered[np.isfinite(ordered)]
    least = 0.0 if finite.size and finite[0] >= 0 else -math.inf
    return PercentileInterval(
        estimate=estimate,
        lower=min(lower, max(estimate - below, least)),
        upper=max(upper, estimate + above),
        levels=levels,
    )


def level_margin(
    values: Sequence[NDArray[np.float64]], starts: Sequence[int], q: float, level: float
) -> LevelMargin | None:
    """Return the margin of a percentile of all values.

    Args:
        values: one array for each iteration.
        starts: the start of each iteration; empty where all belong to the same start.
        q: the percentile, 0 < q < 1.
        level: of a bound, one-sided.

    Returns:
        None with fewer than two levels, or where the middle half of one is lost.
    """
    kept = [value for value in values if value.size]
    numbers = [start for start, row in zip(starts, values, strict=False) if row.size]
    middles = [middle_half(row) for row in kept]
    if len(kept) < _MIN_LEVELS or not all(map(math.isfinite, middles)):
        return None
    apart = [np.abs(row - middle) for row, middle in zip(kept, middles, strict=True)]
    inside = _MAD_TO_DEVIATION * float(np.median(np.concatenate(apart)))
    margins = [_margin(middles, inside, q, level, "iterations")]
    if len(set(numbers)) >= _MIN_LEVELS:
        of_starts = [middle_half(np.concatenate(group)) for group in by_start(kept, numbers)]
        margins.append(_margin(of_starts, inside, q, level, "starts"))
    return max(margins, key=lambda margin: margin.tail)


def middle_half(values: NDArray[np.float64]) -> float:
    """Return the mean of the middle half of some values; infinite if it has a lost value."""
    cut = values.size // 4
    middle = np.sort(values)[cut : values.size - cut]
    # An exact sum: its digits do not depend on the processor.
    return math.fsum(middle) / middle.size if np.isfinite(middle).all() else math.inf


def _margin(
    levels: Sequence[float],
    inside: float,
    q: float,
    level: float,
    pieces: Literal["iterations", "starts"],
) -> LevelMargin:
    from scipy.special import ndtri

    m = len(levels)
    mean = math.fsum(levels) / m
    variance = math.fsum((middle - mean) ** 2 for middle in levels) / (m - 1)
    total = variance + inside**2
    z = abs(float(ndtri(q)))
    reach = z**2 * variance / total / (2 * (m - 1)) if total > 0 else 0.0
    t = t_quantile(m - 1, level)
    half = t * math.sqrt(variance * (1 / m + reach))
    largest = deviation_bound(math.sqrt(variance), m, level)
    wider = z * (math.hypot(largest, inside) - math.sqrt(total))
    tail = max(half, math.hypot(t * math.sqrt(variance / m), wider))
    return LevelMargin(half, tail, math.sqrt(variance), m, pieces)
