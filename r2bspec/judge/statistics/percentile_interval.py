"""Confidence bounds on a percentile, from order statistics and from levels.

Levels
------

The binomial test counts messages, and estimates from the counts by how much iterations differ
(`effective_sample_size`). Of a p99 it has a few bad messages in each iteration, hardly enough to
see that iterations differ, and not enough to see that each resembles the one before. The bulk of
the messages shows both far better: whatever makes an iteration or a start slower as a whole moves
its middle, too.

The level u of an iteration (or start) is the mean of the middle half of its values. With the
standard deviation s of m levels, F by their correlation in time (`autocorrelation`), and t at the
confidence c, the percentile q of all messages is open by at least

    h = t_c s sqrt(F) sqrt(1 / m + z^2 s^2 / (s^2 + e^2) / (2 (m - 1))).

The first part is the interval of a mean over m values. The second is for a high or low percentile
of a mixture, which lies z = |Phi^-1(q)| standard deviations sqrt(s^2 + e^2) from its middle, where
e (1.4826 times the median absolute deviation from the level) is that of the messages of one
iteration: s has a standard error of s / sqrt(2 (m - 1)).

Few levels show far too small an s as easily as one that is a little too large, and then the tail of
the mixture is too near. So on the side of its tail a percentile is open by at least

    sqrt(t_c^2 s^2 F / m + z^2 (sqrt(u^2 + e^2) - sqrt(s^2 + e^2))^2),     u^2 = (m - 1) s^2 / chi2,

with chi2 the 1 - c quantile of m - 1 degrees of freedom: u is the upper bound of the deviation, and
the parts are added as in Graybill and Wang, "Confidence intervals on nonnegative linear
combinations of variances", JASA 75, 1980.

Where there are several starts, h is the larger one of starts and iterations, and only starts may be
correlated: two iterations of one start resemble each other anyway.

Order statistics
----------------

Whether a percentile q lies below a limit is the question whether at most a share 1 - q of all
messages is over it. If exactly the k largest messages are over the limit, they count as k / F of
n / F independent messages (`effective_sample_size`), and F depends on which messages these are,
hence on k.
The binomial test on k / F and n / F says 'pass', 'fail' or neither for each k. With

    k_pass = the largest k such that it passes for every k' <= k
    k_fail = the smallest k such that it fails for every k' >= k

the requirement passes exactly if the (k_pass + 1)-th largest message is within the limit, and
fails exactly if the k_fail-th largest is over it. So these two messages are the upper and the
lower confidence bound on the percentile: comparing them with the limit is the test itself.
Requiring it for every k' makes the verdict monotone (a looser limit never turns a pass into less)
and can only make it more conservative.

A percentile is also open by as much as the levels of iterations and starts leave it
(`level_margin`): the bounds are at least that far from the estimate.

F is worked out for some k, every one up to 16 and then in steps of a fifth, from either end, and
is the same from one of them down to the one before.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from r2bspec.judge.measure.times import rank
from r2bspec.judge.statistics.autocorrelation import serial_degrees_of_freedom, serial_inflation
from r2bspec.judge.statistics.binomial import last_true, lower_bound, upper_bound
from r2bspec.judge.statistics.effective_sample_size import (
    ONE_START,
    Clustering,
    EffectiveSample,
    SampleDesign,
    effective_sample_of_rows,
    pad_rows,
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
        inflation: F, by the correlation of the levels in time.
    """

    half: float
    tail: float
    deviation: float
    number: int
    pieces: Literal["iterations", "starts"]
    inflation: float


def level_margin(
    values: Sequence[NDArray[np.float64]], starts: Sequence[int], q: float, confidence: float
) -> LevelMargin | None:
    """The margin of a percentile of all values.

    Args:
        values: one array for each iteration.
        starts: the start of each iteration; empty where all belong to one.
        q: the percentile, 0 < q < 1.
        confidence: of a bound, one-sided.

    Returns:
        None with fewer than two levels, or where the middle half of one is lost.
    """
    kept = [value for value in values if value.size]
    numbers = [start for start, row in zip(starts, values, strict=False) if row.size]
    groups = by_start(kept, numbers) if len(set(numbers)) >= _MIN_LEVELS else []
    levels = [middle_half(row) for row in kept]
    if len(kept) < _MIN_LEVELS or not all(map(math.isfinite, levels)):
        return None
    inside = deviation_within(kept, levels)
    margins = [_margin(levels, inside, q, confidence, "iterations", serial=not groups)]
    if groups:
        of_starts = [middle_half(np.concatenate(group)) for group in groups]
        margins.append(_margin(of_starts, inside, q, confidence, "starts", serial=True))
    return max(margins, key=lambda one: one.tail)


def middle_half(values: NDArray[np.float64]) -> float:
    """The level of some values: the mean of their middle half; infinite if one of that is lost."""
    cut = values.size // 4
    middle = np.sort(values)[cut : values.size - cut]
    # An exact sum: its digits do not depend on the processor.
    return math.fsum(middle) / middle.size if np.isfinite(middle).all() else math.inf


def middle_ends(values: NDArray[np.float64]) -> tuple[float, float]:
    """The smallest and the largest value of the middle half: finite where the level is."""
    cut, ordered = values.size // 4, np.sort(values)
    return float(ordered[cut]), float(ordered[values.size - cut - 1])


def deviation_within(values: Sequence[NDArray[np.float64]], levels: Sequence[float]) -> float:
    """The deviation of the values of each iteration or start from its level: e above."""
    apart = [np.abs(row - level) for row, level in zip(values, levels, strict=True)]
    return _MAD_TO_DEVIATION * float(np.median(np.concatenate(apart)))


def _margin(
    levels: Sequence[float],
    inside: float,
    q: float,
    confidence: float,
    pieces: Literal["iterations", "starts"],
    *,
    serial: bool,
) -> LevelMargin:
    from scipy.special import ndtri

    m = len(levels)
    mean = math.fsum(levels) / m
    variance = math.fsum((level - mean) ** 2 for level in levels) / (m - 1)
    inflation = serial_inflation(levels) if serial else 1.0
    total = variance + inside**2
    z = abs(float(ndtri(q)))
    reach = z**2 * variance / total / (2 * (m - 1)) if total > 0 else 0.0
    t = t_quantile(serial_degrees_of_freedom(m, inflation), confidence)
    half = t * math.sqrt(variance * inflation * (1 / m + reach))
    largest = deviation_bound(math.sqrt(variance), m, confidence)
    wider = z * (math.hypot(largest, inside) - math.sqrt(total))
    tail = max(half, math.hypot(t * math.sqrt(variance * inflation / m), wider))
    return LevelMargin(half, tail, math.sqrt(variance), m, pieces, inflation)


_EXACT_LEVELS = 16
_LEVEL_GROWTH = 1.2


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
    """1 - q, without the digits that binary floating point adds to it: 0.01 for 0.99."""
    return round(1 - q, 12)


class RankedMessages:
    """The messages of some iterations, in the order played and in the order of size.

    Attributes:
        n: how many there are.
        ordered: all of them, ascending; shape (n,).
    """

    def __init__(
        self, pieces: Sequence[NDArray[np.float64]], design: SampleDesign = ONE_START
    ) -> None:
        """Take one array for each iteration; lost messages are +inf or -inf, whichever is worse.

        Args:
            pieces: in the order they were played.
            design: their starts, the share that is allowed, and the confidence.
        """
        # Levels show better than counts whether iterations are correlated (`level_margin`).
        self._design = replace(design, serial=False)
        self._pieces = pieces
        self._rows = pad_rows(pieces, fill=math.nan)
        self._sizes = np.array([piece.size for piece in pieces])
        self.ordered = np.sort(np.concatenate([*pieces, np.empty(0)]))
        self.n = int(self.ordered.size)
        self._levels = _levels(self.n)
        self._found: dict[int, tuple[float, Clustering]] = {}

    def effective_sample(self, k: int, *, largest: bool = True) -> EffectiveSample:
        """The effective sample if the k largest messages are bad, or all but those k."""
        level = min(level for level in self._levels if level >= k)
        inflation, cause = self._inflation_at(level)
        # The largest message that is not one of the k largest.
        edge = float(self.ordered[self.n - 1 - k]) if k < self.n else -math.inf
        # Behind the end of an iteration there is NaN, which is neither over nor under.
        flags = self._rows > edge if largest else self._rows <= edge
        return replace(
            effective_sample_of_rows(flags, self._sizes, self._design),
            inflation=inflation,
            cause=cause,
        )

    def _inflation_at(self, level: int) -> tuple[float, Clustering]:
        """F at one of the levels, and which estimate it is."""
        if level not in self._found:
            effective = self._sample_at(level)
            self._found[level] = effective.inflation, effective.cause
        return self._found[level]

    def _sample_at(self, level: int, *, at_most: bool = False) -> EffectiveSample:
        least = self.ordered[self.n - level] if level else math.nan
        flags = self._rows >= least
        return effective_sample_of_rows(flags, self._sizes, self._design, at_most=at_most)

    def level_margin(self, q: float, confidence: float) -> LevelMargin | None:
        """By how much the levels of iterations and starts leave a percentile open."""
        return level_margin(self._pieces, self._design.starts, q, confidence)

    def max_passing(self, allowed: float, confidence: float) -> int | None:
        """k_pass; None if not even 0 passes."""

        def passes(k: int, f: float) -> bool:
            return upper_bound(k / f, self.n / f, confidence) <= allowed

        best: int | None = None
        for below, level in self._buckets():
            # Far from the limit, no F that there can be says otherwise.
            if passes(level, self._sample_at(level, at_most=True).inflation):
                best = level
                continue
            f, _ = self._inflation_at(level)
            if not passes(below + 1, f):
                return best
            best = last_true(partial(passes, f=f), below + 1, level)
            if best < level:
                return best
        return best

    def min_failing(self, allowed: float, confidence: float) -> int | None:
        """k_fail; None if not even n fails."""

        def open_(k: int, f: float) -> bool:
            return lower_bound(k / f, self.n / f, confidence) <= allowed

        best: int | None = None
        for below, level in reversed(list(self._buckets())):
            if not open_(below + 1, self._sample_at(level, at_most=True).inflation):
                best = below + 1
                continue
            f, _ = self._inflation_at(level)
            if open_(level, f):
                return best
            if open_(below + 1, f):
                return last_true(partial(open_, f=f), below + 1, level) + 1
            best = below + 1
        return best

    def _buckets(self) -> Iterator[tuple[int, int]]:
        """(a, b) for each range a < k <= b with the F of b, ascending from (-1, 0)."""
        yield from zip((-1, *self._levels), self._levels, strict=False)


def _levels(n: int) -> tuple[int, ...]:
    """The k at which F is worked out, ascending, from 0 to n."""
    levels = set(range(min(_EXACT_LEVELS, n) + 1))
    level = float(_EXACT_LEVELS)
    while level < n:
        level *= _LEVEL_GROWTH
        levels.add(min(math.ceil(level), n))
    return tuple(sorted(levels | {n - k for k in levels}))


def percentile_interval(
    pieces: Sequence[NDArray[np.float64]] | RankedMessages, q: float, confidence: float
) -> PercentileInterval:
    """The percentile `q` of all messages and its one-sided bounds, each at `confidence`.

    Args:
        pieces: one array for each iteration, in the order of the steps, at least one message in
            all; messages that were lost are +inf, or -inf for a lower limit.
        q: 0 < q < 1.
        confidence: of each bound by itself.
    """
    ranked = pieces if isinstance(pieces, RankedMessages) else RankedMessages(pieces)
    n, ordered = ranked.n, ranked.ordered
    passing = ranked.max_passing(allowed_share(q), confidence)
    failing = ranked.min_failing(allowed_share(q), confidence)
    estimate = float(ordered[rank(q, n) - 1])
    levels = ranked.level_margin(q, confidence)
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
