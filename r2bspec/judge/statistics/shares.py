"""Bounds on a share of messages that differs between iterations and starts.

Of n messages k are bad: over a limit, or lost. Clopper-Pearson bounds take messages to be
independent. They are not: a stall makes successive messages late, and an iteration, or a start of
the graph's processes, may be worse than the others. The count then scatters more than a binomial
count by a factor F, the design effect, and k bad of n messages are tested as k / F of n / F.

With k_1 .. k_m bad messages in m pieces, V is the variance of these counts over the binomial one.
It is known from m values only, so the quantiles of t take the place of the normal ones:

    F = V (t_l(m - 1) / z_c)^2,    at least 1,

with the confidence c of the decision, and the level l of what differs between pieces, which is a
little above c (`scatter_level`). F is the largest value over the starts and over the iterations,
where there are at least two (a run is a hierarchical sample: Kalibera and Jones, "Rigorous
benchmarking in reasonable time", ISMM 2013). A single iteration is cut into ten stretches.

If pieces differ by a factor, the variance of their shares rises with p^2: a run that by chance had
its better starts would also look uniform. So where p = k / n is nearer to 0 or 1 than the allowed
share p_0, and V exceeds 1, its excess V - 1 is multiplied by

    p_0 (1 - p_0) / (p (1 - p)),    at most 4.

Fewer bad messages never give a worse bound
-------------------------------------------

A piece that loses less than the others makes V larger: as it stands, 2 lost of 1,500 in a single
start would be open where 6 lost, one or two in each start, pass. So the upper bound is the smallest
that any number of bad messages T >= k gives which could have been added to the pieces, always to
those with the smallest share, until the pieces are as even as T permits. No other way to add them
has a smaller V, and whatever can be added to a run can be added to a run with fewer bad messages:
the bound never falls when a message becomes bad. The lower bound is the same of the good messages.
This makes a verdict monotone in its limit, too. The level l pays for it.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Final, Literal, TypeVar

import numpy as np
from numpy.typing import NDArray

from r2bspec.judge.statistics.t_interval import by_start

_Scalar = TypeVar("_Scalar", bound=np.generic)
_Floats = NDArray[np.float64]

Pieces = Literal["", "stretches", "iterations", "starts"]

Counts = Mapping[Pieces, NDArray[np.int64]]
"""A number for each piece, by what the pieces are; all mappings of a sample have the same keys."""

_STRETCHES: Final = 10
_MIN_PIECES: Final = 2
_MAX_EXCESS_RATIO: Final = 4.0
_STEP: Final = 0.1
"""Of the standard deviation of a count: how far apart the numbers T are that are tried."""


@dataclass(frozen=True)
class ShareBounds:
    """A share of messages with its one-sided bounds.

    Attributes:
        n: messages.
        bad: bad messages among them.
        effect: the design effect of the bound that is nearer to the allowed share.
        differ: the pieces whose scatter makes it larger than 1; empty if none does.
    """

    n: int
    bad: int
    lower: float
    upper: float
    effect: float = 1.0
    differ: Pieces = ""


@dataclass(frozen=True)
class ShareLimit:
    """The share that is tested, and the confidence of the test.

    Attributes:
        allowed: the share.
        confidence: c, of each bound by itself.
        level: l, for what differs between pieces.
    """

    allowed: float
    confidence: float
    level: float


def pieces_of_levels(
    iterations: Sequence[NDArray[_Scalar]], starts: Sequence[int]
) -> dict[Pieces, list[NDArray[_Scalar]]]:
    """Return the messages of iterations and starts, or of the stretches of a single iteration.

    Args:
        iterations: one array for each iteration, in the order of time.
        starts: the start of each iteration; empty where all belong to the same start.
    """
    kept = [row for row in iterations if row.size]
    numbers = [start for start, row in zip(starts, iterations, strict=False) if row.size]
    if len(kept) <= 1:
        whole = kept[0] if kept else np.concatenate([*iterations, np.empty(0)])
        return {"stretches": np.array_split(whole, max(1, min(_STRETCHES, whole.size)))}
    if len(set(numbers)) < _MIN_PIECES:
        return {"iterations": kept}
    of_starts = [np.concatenate(group) for group in by_start(kept, numbers)]
    return {"iterations": kept, "starts": of_starts}


def bounds_of_flags(
    iterations: Sequence[NDArray[np.bool_]],
    starts: Sequence[int],
    test: ShareLimit,
    upper_level: float | None = None,
) -> ShareBounds:
    """Return the bounds on the share of true flags; see `share_bounds`."""
    levels = pieces_of_levels(iterations, starts)
    counts: Counts = {
        differ: np.array([np.count_nonzero(piece) for piece in pieces])
        for differ, pieces in levels.items()
    }
    return share_bounds(counts, sizes_of(levels), test, upper_level)


def sizes_of(levels: Mapping[Pieces, Sequence[NDArray[_Scalar]]]) -> Counts:
    """Return the number of messages of each piece."""
    return {differ: np.array([row.size for row in rows]) for differ, rows in levels.items()}


def share_bounds(
    counts: Counts, sizes: Counts, test: ShareLimit, upper_level: float | None = None
) -> ShareBounds:
    """Return the bounds on a share.

    Args:
        counts: the bad messages of each piece.
        sizes: all messages of each piece.
        test: the test of the share.
        upper_level: l of the upper bound, if it has another.
    """
    first = next(iter(counts))
    n, bad = int(sizes[first].sum()), int(counts[first].sum())
    if not n:
        return ShareBounds(0, 0, 0.0, 1.0)
    above = ShareLimit(test.allowed, test.confidence, upper_level or test.level)
    upper, upper_effect = _upper(counts, sizes, above)
    good = {differ: sizes[differ] - counts[differ] for differ in counts}
    below = ShareLimit(1 - test.allowed, test.confidence, test.level)
    most_good, lower_effect = _upper(good, sizes, below)
    effect, differ = upper_effect if bad <= test.allowed * n else lower_effect
    lower = 1 - most_good if bad else 0.0
    return ShareBounds(n, bad, max(lower, 0.0), upper, effect, differ)


def _upper(counts: Counts, sizes: Counts, test: ShareLimit) -> tuple[float, tuple[float, Pieces]]:
    """Return the upper bound, and the design effect behind it with the pieces that cause it."""
    from scipy.special import betaincinv

    first = next(iter(counts))
    n, bad = int(sizes[first].sum()), int(counts[first].sum())
    totals = _totals(n)
    at = int(np.searchsorted(totals, bad))

    def bounds(tried: _Floats) -> tuple[_Floats, dict[Pieces, _Floats]]:
        effects = {
            differ: _effects(_added(counts[differ], sizes[differ], tried), sizes[differ], test)
            for differ in counts
        }
        # One message remains at least.
        f = np.minimum(np.max([*effects.values()], axis=0), n)
        left = np.maximum((n - tried) / f, 1e-12)
        bound = np.where(tried < n, betaincinv(tried / f + 1, left, test.confidence), 1.0)
        return np.asarray(bound), effects

    # A bound is never below the share itself: more than this many cannot give a smaller bound.
    most = n * float(bounds(totals[at : at + 1])[0][0])
    tried = totals[at : max(at + 1, int(np.searchsorted(totals, most, side="right")))]
    found, effects = bounds(tried)
    best = int(np.argmin(found))
    differ = max(effects, key=lambda differ: float(effects[differ][best]))
    effect = min(float(effects[differ][best]), float(n))
    return float(found[best]), (effect, differ if effect > 1 else "")


@cache
def _totals(n: int) -> _Floats:
    """Return the numbers of bad messages of n that are tried, ascending, from 0 to n."""
    totals, at = [0], 0
    while at < n:
        at = min(n, at + max(1, int(_STEP * math.sqrt(at * (1 - at / n)))))
        totals.append(at)
    return np.array(totals, dtype=np.float64)


def _added(counts: NDArray[np.int64], sizes: NDArray[np.int64], totals: _Floats) -> _Floats:
    """Return the counts with bad messages added up to each total, as evenly as can be.

    Args:
        counts: of each piece, shape (m,).
        sizes: the size of each piece.
        totals: at least the sum of the counts, shape (n,).

    Returns:
        Shape (n, m): the larger one of what a piece has and of a share that is common to all.
    """
    shares = np.append(np.sort(counts / sizes), 1.0)
    reached = np.maximum(counts, shares[:, np.newaxis] * sizes).sum(axis=1)
    common = np.interp(totals, reached, shares)
    return np.asarray(np.maximum(counts, common[:, np.newaxis] * sizes))


def _effects(counts: _Floats, sizes: NDArray[np.int64], test: ShareLimit) -> _Floats:
    """Return F for each row of counts, shape (n, m)."""
    m, n = sizes.size, int(sizes.sum())
    p = counts.sum(axis=1) / n
    scatter = p * (1 - p)
    some = scatter > 0
    if m < _MIN_PIECES or not some.any():
        return np.ones(len(counts))
    squares = (sizes * (counts / sizes - p[:, np.newaxis]) ** 2).sum(axis=1)
    binomial = np.where(some, scatter, 1.0)
    variance = squares / (m - 1) / binomial
    at_allowed = test.allowed * (1 - test.allowed)
    ratio = np.clip(at_allowed / binomial, 1.0, _MAX_EXCESS_RATIO) if at_allowed > 0 else 1.0
    variance = variance + np.maximum(0.0, variance - 1) * (ratio - 1)
    factor = _small_sample_factor(m - 1, test.confidence, test.level)
    # Digits that the order of additions decides are cut off.
    return np.asarray(np.where(some, np.maximum(np.round(variance * factor, 6), 1.0), 1.0))


@cache
def _small_sample_factor(freedom: int, confidence: float, level: float) -> float:
    """Return (t_l(freedom) / z_c)^2."""
    from scipy.special import ndtri, stdtrit

    return float(stdtrit(freedom, level) / ndtri(confidence)) ** 2
