"""How many independent messages a run is worth: bad messages come in bursts.

The binomial test takes messages to be independent. They are not: one stall of the machine makes
five messages late, a busy second ten more, and one whole iteration may be worse than the others.
The number of bad messages then scatters more than a binomial one by a factor F, its variance
inflation, and n messages tell as much as n / F independent ones would. F is the largest of three
estimates, each of which sees what the others miss. With x_i = 1 where message i is bad and 0
otherwise, k their sum, p = k / n, in m iterations:

    bursts      A burst is a run of bad messages without a good one between them. A two-state
                Markov chain with the mean burst L has the lag-1 autocorrelation
                    r = 1 - 1 / (L (1 - p))      and      F = (1 + r) / (1 - r).
                L is (k + longest burst) / (number of bursts): the longest is counted twice,
                because few bursts hardly ever hold the longest that there is.
    stretches   Bad messages that are near each other but not next to each other. With the
                autocorrelations r_1, r_2, .. of x within iterations, up to a quarter of an
                iteration and at most 200 messages,
                    F = -1 + 2 (r_0 + r_1 + ..),
                by Geyer's initial monotone sequence (`correlation`).
    iterations  With k_1 .. k_m bad messages in five or more iterations, F is the variance of
                these counts over the binomial one, n p (1 - p) / m. It is known from m values
                only, so that the quantiles of t take the place of the normal ones:
                    F = variance / (n p (1 - p) / m) x (t_c(m - 1) / z_c)^2,    c = 0.95.

F is at least 1: counts that scatter less than binomial ones are not held in favour of a run. No
pair of messages spans two iterations. Where nothing is bad, there is nothing to estimate: F is 1.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from typing import Literal, TypeVar

import numpy as np
from numpy.typing import NDArray

from r2bspec.judge.statistics.variance_inflation import inflation, lagged_products

_Scalar = TypeVar("_Scalar", bound=np.generic)

Clustering = Literal["", "bursts", "stretches", "iterations"]

BadFlags = NDArray[np.bool_]
"""Which of the messages of one iteration are bad, in the order of the steps; shape (n,)."""

_MAX_LAG = 200
"""Messages; what is correlated over a longer distance shows between iterations."""
_LAG_DIVISOR = 4

_MIN_ITERATIONS = 5
"""Fewer iterations say next to nothing about how much iterations differ."""

_REFERENCE_LEVEL = 0.95
_MAX_AUTOCORRELATION = 0.999


@dataclass(frozen=True)
class EffectiveSample:
    """What a number of messages is worth.

    Attributes:
        n: messages.
        bad: bad ones among them.
        bursts: runs of bad messages without a good one between them.
        inflation: F, at least 1.
        cause: which estimate is the largest; empty if none is above 1.
    """

    n: int
    bad: int
    bursts: int
    inflation: float
    cause: Clustering

    @property
    def messages(self) -> float:
        """Independent ones they are worth: n / F."""
        return self.n / self.inflation

    @property
    def bad_messages(self) -> float:
        """Of those, bad ones: k / F."""
        return self.bad / self.inflation


def effective_sample(pieces: Sequence[BadFlags]) -> EffectiveSample:
    """What the messages of some iterations are worth.

    Args:
        pieces: one array for each iteration, in the order they were played.
    """
    return effective_sample_of_rows(
        pad_rows(pieces, fill=False), np.array([one.size for one in pieces])
    )


def pad_rows(pieces: Sequence[NDArray[_Scalar]], fill: object) -> NDArray[_Scalar]:
    """Arrays of different lengths as the rows of one, `fill` behind the shorter ones."""
    longest = max((piece.size for piece in pieces), default=0)
    rows: NDArray[_Scalar] = np.full((len(pieces), longest), fill)
    for row, piece in zip(rows, pieces, strict=True):
        row[: piece.size] = piece
    return rows


def effective_sample_of_rows(flags: BadFlags, sizes: NDArray[np.int64]) -> EffectiveSample:
    """What the messages of some iterations are worth, which are the rows of one array.

    Args:
        flags: shape (iterations, longest), False behind the end of an iteration.
        sizes: the messages of each iteration, shape (iterations,).
    """
    n = int(sizes.sum())
    counts = np.count_nonzero(flags, axis=1) if flags.size else np.zeros(0, dtype=np.int64)
    bad = int(counts.sum())
    bursts, longest = _bursts(flags)
    if not 0 < bad < n:
        return EffectiveSample(n=n, bad=bad, bursts=bursts, inflation=1.0, cause="")
    estimates: dict[Clustering, float] = {
        "": 1.0,
        "bursts": _burst_inflation(n, bad, bursts, longest),
        "stretches": _autocorrelation_inflation(flags, sizes, bad / n),
        "iterations": _iteration_inflation(counts, sizes, bad / n),
    }
    # Digits that the order of additions decides, which differs between processors, are cut off
    # before anything is compared. One message is the least that a run with any can be worth.
    cause, largest = max(
        ((cause, round(found, 6)) for cause, found in estimates.items()), key=lambda one: one[1]
    )
    return EffectiveSample(
        n=n, bad=bad, bursts=bursts, inflation=min(largest, float(n)), cause=cause
    )


def _bursts(flags: BadFlags) -> tuple[int, int]:
    """How many bursts there are, and how long the longest is."""
    if not flags.size:
        return 0, 0
    # A column of good ones between the rows, so that no burst spans two.
    line = np.zeros((flags.shape[0], flags.shape[1] + 1), dtype=np.bool_)
    line[:, 1:] = flags
    edges = np.flatnonzero(np.diff(np.append(line.ravel(), False)))
    lengths = edges[1::2] - edges[::2]
    return int(lengths.size), int(lengths.max(initial=0))


def _burst_inflation(n: int, bad: int, bursts: int, longest: int) -> float:
    if longest < 2:
        return 1.0
    mean = (bad + longest) / bursts
    r = min(1 - 1 / (mean * (1 - bad / n)), _MAX_AUTOCORRELATION)
    return (1 + r) / (1 - r)


def _autocorrelation_inflation(flags: BadFlags, sizes: NDArray[np.int64], p: float) -> float:
    filled = sizes[sizes > 0]
    lags = min(_MAX_LAG, int(filled.min()) // _LAG_DIVISOR)
    if lags < 2:
        return 1.0
    inside = np.arange(flags.shape[1]) < sizes[:, np.newaxis]
    deviations = np.where(inside, flags - p, 0.0)
    pairs = filled.sum() - filled.size * np.arange(lags + 1)
    r = lagged_products(deviations, lags) / pairs
    return inflation(r / r[0])


def _iteration_inflation(counts: NDArray[np.int64], sizes: NDArray[np.int64], p: float) -> float:
    counts, sizes = counts[sizes > 0], sizes[sizes > 0]
    m = sizes.size
    if m < _MIN_ITERATIONS:
        return 1.0
    # Iterations of one rate are equally long, but for a step; shares serve all.
    excess = float((sizes * (counts / sizes - p) ** 2).sum())
    return excess / (m - 1) / (p * (1 - p)) * _small_sample_factor(m)


@cache
def _small_sample_factor(m: int) -> float:
    """(t_c(m - 1) / z_c)^2."""
    from scipy.special import ndtri, stdtrit

    return float(stdtrit(m - 1, _REFERENCE_LEVEL) / ndtri(_REFERENCE_LEVEL)) ** 2
