"""The effective sample size of a run: bad messages come in bursts.

The binomial test takes messages to be independent. They are not: one stall of the machine makes
five messages late, a busy second ten more, and one whole iteration, or one start of the graph's
processes, may be worse than the others. The number of bad messages then scatters more than a
binomial one by a factor F, its variance inflation, and n messages carry the information of n / F
independent ones. F is the largest of four estimates, each of which covers what the others miss.
With x_i = 1 where message i is bad and 0 otherwise, k their sum, p = k / n:

    bursts      A burst is a run of bad messages without a good one between them. A two-state
                Markov chain with the mean burst L has the lag-1 autocorrelation
                    r = 1 - 1 / (L (1 - p))      and      F = (1 + r) / (1 - r).
                L is (k + longest burst) / (number of bursts): the longest is counted twice,
                because few bursts hardly ever include the longest possible one.
    clusters    Bad messages that are near each other but not next to each other. With the
                autocorrelations r_1, r_2, .. of x within iterations, up to a quarter of an
                iteration and at most 200 messages,
                    F = -1 + 2 (r_0 + r_1 + ..),
                by Geyer's initial monotone sequence (`autocorrelation`).
    iterations  With k_1 .. k_m bad messages in two or more iterations, V is the variance of
                these counts over the binomial one, n p (1 - p) / m. It is known from m values
                only, so that the quantiles of t take the place of the normal ones:
                    F = V (t_c(m - 1) / z_c)^2,    c the confidence of the decision.
                If V exceeds 1, the iterations themselves differ, and may be correlated from one to
                the next: F is then inflated once more (`autocorrelation`). Where each message has a
                value, its levels show that better than counts (`percentile_interval`).
    starts      The same for the counts of whole starts. A run with several starts is a
                hierarchical sample: messages in iterations in starts. What differs between starts
                is known from so many values as there are starts, however many iterations each has
                (Kalibera and Jones, "Rigorous benchmarking in reasonable time", ISMM 2013). The
                highest level is the one that may be correlated in time.

F is assessed where it is needed. If iterations or starts differ by a factor, the variance of their
shares rises with p^2: a run that by chance had its better starts would also look uniform. So where
p is nearer to 0 or 1 than the allowed share p_0, and V exceeds 1, its excess V - 1 is taken to be
that at p_0, where it is larger by the ratio

    p_0 (1 - p_0) / (p (1 - p)),    at most 4.

F is at least 1: counts that scatter less than binomial ones do not help a run. No pair of messages
spans two iterations. Without bad messages there is nothing to estimate: F is 1.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from typing import Final, Literal, TypeVar

import numpy as np
from numpy.typing import NDArray

from r2bspec.judge.statistics.autocorrelation import (
    geyer_inflation,
    lagged_products,
    serial_degrees_of_freedom,
    serial_inflation,
)
from r2bspec.language.benchmark_defaults import CONFIDENCE

_Scalar = TypeVar("_Scalar", bound=np.generic)

Clustering = Literal["", "bursts", "clusters", "iterations", "starts"]

BadFlags = NDArray[np.bool_]
"""Which of the messages of one iteration are bad, in the order of the steps; shape (n,)."""

_MAX_LAG = 200
"""Messages; correlation over a longer distance shows between iterations."""
_LAG_DIVISOR = 4

_MIN_PIECES = 2
_MAX_EXCESS_RATIO = 4.0
_MAX_AUTOCORRELATION = 0.999


@dataclass(frozen=True)
class SampleDesign:
    """How a sample came about, and what it is asked.

    Attributes:
        starts: for each iteration, the start of the graph's processes that it was played in;
            empty where all belong to one.
        allowed: the share that is tested; None if only the observed one matters.
        confidence: of the decision, which decides how much few iterations or starts count.
        serial: whether shares of successive iterations or starts may be correlated. Without it,
            something else covers that (`percentile_interval`).
    """

    starts: tuple[int, ...] = ()
    allowed: float | None = None
    confidence: float = CONFIDENCE
    serial: bool = True


ONE_START: Final = SampleDesign()


@dataclass(frozen=True)
class EffectiveSample:
    """A number of messages and its effective sample size.

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
        """Effective sample size: n / F."""
        return self.n / self.inflation

    @property
    def bad_messages(self) -> float:
        """Bad messages in the effective sample: k / F."""
        return self.bad / self.inflation


def effective_sample(
    pieces: Sequence[BadFlags], design: SampleDesign = ONE_START
) -> EffectiveSample:
    """The effective sample of the messages of some iterations.

    Args:
        pieces: one array for each iteration, in the order they were played.
        design: their starts, and what is asked.
    """
    return effective_sample_of_rows(
        pad_rows(pieces, fill=False), np.array([piece.size for piece in pieces]), design
    )


def pad_rows(pieces: Sequence[NDArray[_Scalar]], fill: object) -> NDArray[_Scalar]:
    """Arrays of different lengths as the rows of one, `fill` behind the shorter ones."""
    longest = max((piece.size for piece in pieces), default=0)
    rows: NDArray[_Scalar] = np.full((len(pieces), longest), fill)
    for row, piece in zip(rows, pieces, strict=True):
        row[: piece.size] = piece
    return rows


def effective_sample_of_rows(
    flags: BadFlags,
    sizes: NDArray[np.int64],
    design: SampleDesign = ONE_START,
    *,
    at_most: bool = False,
) -> EffectiveSample:
    """The effective sample of some iterations, which are the rows of one array.

    Args:
        flags: shape (iterations, longest), False behind the end of an iteration.
        sizes: the messages of each iteration, shape (iterations,).
        design: the starts of the iterations, and what is asked.
        at_most: have an upper bound of F in its place: it takes no Fourier transform.
    """
    n = int(sizes.sum())
    counts = np.count_nonzero(flags, axis=1) if flags.size else np.zeros(0, dtype=np.int64)
    bad = int(counts.sum())
    number, longest = bursts(flags)
    if not 0 < bad < n:
        return EffectiveSample(n=n, bad=bad, bursts=number, inflation=1.0, cause="")
    estimates: dict[Clustering, float] = {
        "": 1.0,
        "bursts": _burst_inflation(n, bad, number, longest),
        "clusters": _most_autocorrelation_inflation(sizes)
        if at_most
        else _autocorrelation_inflation(flags, sizes, bad / n),
        **_level_inflations(counts, sizes, design),
    }
    # Digits that the order of additions decides, which differs between processors, are cut off
    # before anything is compared. The effective sample has at least one message.
    cause, largest = max(
        ((cause, round(estimate, 6)) for cause, estimate in estimates.items()),
        key=lambda one: one[1],
    )
    return EffectiveSample(
        n=n, bad=bad, bursts=number, inflation=min(largest, float(n)), cause=cause
    )


def bursts(flags: BadFlags) -> tuple[int, int]:
    """How many bursts there are in the rows of an array, and how long the longest is."""
    if not flags.size:
        return 0, 0
    # A column of good ones between the rows, so that no burst spans two.
    line = np.zeros((flags.shape[0], flags.shape[1] + 1), dtype=np.bool_)
    line[:, 1:] = flags
    edges = np.flatnonzero(np.diff(np.append(line.ravel(), False)))
    lengths = edges[1::2] - edges[::2]
    return int(lengths.size), int(lengths.max(initial=0))


def _burst_inflation(n: int, bad: int, number: int, longest: int) -> float:
    if longest < 2:
        return 1.0
    mean = (bad + longest) / number
    r = min(1 - 1 / (mean * (1 - bad / n)), _MAX_AUTOCORRELATION)
    return (1 + r) / (1 - r)


def _lags(sizes: NDArray[np.int64]) -> int:
    """The largest lag of an autocorrelation within iterations, at least one of them not empty."""
    return min(_MAX_LAG, int(sizes[sizes > 0].min()) // _LAG_DIVISOR)


def _most_autocorrelation_inflation(sizes: NDArray[np.int64]) -> float:
    """What F by clusters cannot exceed, whichever messages are bad.

    The sum of v_i v_(i + lag) is at most that of v_i^2, and at least three quarters of the messages
    have a pair: r_lag is at most 4 / 3, and so each sum of two at most r_0 + 4 / 3.
    """
    return max(1.0, -1 + 2 * (1 + 4 / 3) * ((_lags(sizes) + 1) // 2)) + 1e-6


def _autocorrelation_inflation(flags: BadFlags, sizes: NDArray[np.int64], p: float) -> float:
    filled, lags = sizes[sizes > 0], _lags(sizes)
    if lags < 2:
        return 1.0
    deviations = flags.astype(np.float64) - p
    if sizes.min() < flags.shape[1]:
        deviations[np.arange(flags.shape[1]) >= sizes[:, np.newaxis]] = 0.0
    pairs = filled.sum() - filled.size * np.arange(lags + 1)
    r = lagged_products(deviations, lags) / pairs
    return geyer_inflation(r / r[0])


def _level_inflations(
    counts: NDArray[np.int64], sizes: NDArray[np.int64], design: SampleDesign
) -> dict[Clustering, float]:
    """F by the iterations, and by the starts where there are several."""
    starts = design.starts
    if len(set(starts)) < _MIN_PIECES:
        return {"iterations": _level_inflation(counts, sizes, design, serial=design.serial)}
    _, number = np.unique(np.array(starts), return_inverse=True)
    by_start = np.bincount(number, counts), np.bincount(number, sizes)
    return {
        "iterations": _level_inflation(counts, sizes, design, serial=False),
        "starts": _level_inflation(*by_start, design, serial=design.serial),
    }


def _level_inflation(
    counts: NDArray[np.int64] | NDArray[np.float64],
    sizes: NDArray[np.int64] | NDArray[np.float64],
    design: SampleDesign,
    *,
    serial: bool,
) -> float:
    """F by the scatter of the shares of some iterations, or of some starts."""
    counts, sizes = counts[sizes > 0], sizes[sizes > 0]
    m = sizes.size
    if m < _MIN_PIECES:
        return 1.0
    p = float(counts.sum() / sizes.sum())
    # Iterations of one rate are equally long, but for a step; shares serve all.
    shares = counts / sizes
    scatter = float((sizes * (shares - p) ** 2).sum()) / (m - 1) / (p * (1 - p))
    between = serial_inflation(shares.tolist()) if serial else 1.0
    factor = _small_sample_factor(serial_degrees_of_freedom(m, between), design.confidence)
    plain = scatter * _small_sample_factor(m - 1.0, design.confidence)
    if scatter <= 1:
        return plain
    ratio = _excess_ratio(p, design.allowed)
    correlated = scatter * between * factor
    return max(plain, correlated) + (plain - plain / scatter) * (ratio - 1)


def _excess_ratio(p: float, allowed: float | None) -> float:
    """By how much larger the excess is at the allowed share than at the observed one."""
    if allowed is None or not 0 < allowed < 1:
        return 1.0
    return min(max(allowed * (1 - allowed) / (p * (1 - p)), 1.0), _MAX_EXCESS_RATIO)


@cache
def _small_sample_factor(freedom: float, confidence: float) -> float:
    """(t_c(freedom) / z_c)^2."""
    from scipy.special import ndtri, stdtrit

    return float(stdtrit(freedom, confidence) / ndtri(confidence)) ** 2
