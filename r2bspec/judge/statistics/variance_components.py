"""What an estimate scatters by: variance components of nested samples, and what more of them gain.

Components
----------

A run is a nested sample: messages x in iterations j in starts i. With the variance s_S^2 between
starts, s_I^2 between iterations of a start, and v of an iteration's value by its messages alone,
the mean of N iterations, J_i of them in start i, has the variance

    V = s_S^2 sum J_i^2 / N^2 + s_I^2 / N + v / N,            s_S^2 / S + (s_I^2 + v) / (S J)

if all starts have J. They are estimated by the nested analysis of variance (Searle, Casella,
McCulloch, "Variance Components", 1992, chapter 3; Kalibera and Jones, "Rigorous benchmarking in
reasonable time", ISMM 2013), with the mean y_ij of an iteration, y_i of a start, and y of all:

    M_S = sum J_i (y_i - y)^2 / (S - 1)       estimates  s_I^2 + v + J_0 s_S^2
    M_I = sum (y_ij - y_i)^2 / (N - S)        estimates  s_I^2 + v
    J_0 = (N - sum J_i^2 / N) / (S - 1)

    v   = mean over the iterations of (variance of its messages) tau / n

where tau is the variance inflation of the mean by the autocorrelation of the messages within
iterations (`autocorrelation`). A deviation from the mean of its own n messages is too small, and so
are the autocorrelations, each by V(mean) = v: v is added to them until it stays. Messages that
resemble each other over more than a tenth of an iteration make iterations differ, and count there.

A component is not below 0; where M_S < M_I, both estimate s_I^2 + v, and are pooled. One that is 0
in truth is positive by chance in about half of the runs, and takes up to a fifth from that below
it; otherwise they are right on average. M_S of S starts scatters by sqrt(2 / (S - 1)): by 71 % with
five starts, and by 32 % with twenty.

For a percentile q, x is 1 for a message beyond the estimate and 0 otherwise: the error of the
estimate is that of the share beyond it, over the density there (Woodruff, "Confidence intervals for
medians and other position measures", JASA 47, 1952). The density is that of the messages within a
standard error of q. Where starts differ by as much as their messages scatter, few of them hardly
show it for a high percentile, which is that of the slowest start: it is then too small.

What more of them gain
----------------------

To decide an open requirement, a new run has to find a value that is further from the limit than its
interval reaches. With the present distance d, the half width h, u = h / t_c, and Student's t with
as many degrees of freedom, a run with g times the information decides with the probability

    P(|d + u sqrt(1 + 1 / g) t| > h / sqrt(g)):

neither the true value nor what the next run finds is known, and this averages over both
(assurance; O'Hagan, Stevens, Campbell, "Assurance in clinical trial design", Pharmaceutical
Statistics 4, 2005). For a share, k / F bad ones of n / F messages have the true share p with the
distribution Beta(k / F + 1/2, n / F - k / F + 1/2), and the probability that the test on g n / F
messages decides is averaged over it. The smallest g with a probability of 80 % is advised.

Of m pieces whose scatter is known from themselves it takes m', with m' / m (t_c(m - 1) / t_c(m' -
1))^2 at least g.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from r2bspec.judge.statistics.autocorrelation import geyer_inflation, lagged_products
from r2bspec.judge.statistics.binomial import last_true, lower_bound, upper_bound
from r2bspec.judge.statistics.effective_sample_size import pad_rows
from r2bspec.judge.statistics.t_interval import t_quantile

ASSURANCE: Final = 0.8
"""The probability with which what is advised decides a requirement."""

MAX_PIECES: Final = 200
"""More starts or pairs are not proposed."""

_MAX_GROWTH: Final = 1000.0
_STEP: Final = 1.05
_POINTS: Final = 64
_LAG_DIVISOR: Final = 4
_MAX_LAG: Final = 1000
_ROUNDS: Final = 5


def sampling_variance(rows: Sequence[NDArray[np.float64]]) -> float:
    """V above: the variance of the mean of an iteration by its messages, averaged over iterations.

    Args:
        rows: the messages of each iteration in the order of time, all finite.
    """
    filled = [row for row in rows if row.size > 1]
    if not filled:
        return 0.0
    sizes = np.array([row.size for row in filled])
    lags = max(1, min(_MAX_LAG, int(sizes.min()) // _LAG_DIVISOR))
    padded, of_row = pad_rows(filled, fill=0.0), sizes[:, np.newaxis]
    means = padded.sum(axis=1, keepdims=True) / of_row
    deviations = np.where(np.arange(padded.shape[1]) < of_row, padded - means, 0.0)
    pairs = sizes.sum() - sizes.size * np.arange(lags + 1)
    covariances = lagged_products(deviations, lags) / pairs
    if not covariances[0] > 0:
        return 0.0
    weight, variance = float(np.mean(1 / sizes)), 0.0
    for _ in range(_ROUNDS):
        raised = covariances + variance
        variance = float(raised[0]) * geyer_inflation(raised / raised[0]) * weight
    return min(variance, float(covariances[0]))


@dataclass(frozen=True)
class NestedSample:
    """The components of the module's text, and how many iterations each start has.

    Attributes:
        starts: s_S^2; 0 with one start.
        iterations: s_I^2; 0 with one iteration in each start.
        sampling: v; 0 where it is not known.
    """

    starts: float
    iterations: float
    sampling: float
    sizes: tuple[int, ...]

    @classmethod
    def of(
        cls, values: Sequence[float], starts: Sequence[int], sampling: float = 0.0
    ) -> NestedSample:
        """From one value for each iteration, the start of each, and v."""
        y, numbers = np.array(values, dtype=np.float64), np.array(starts)
        groups = [y[numbers == number] for number in dict.fromkeys(starts)]
        sizes = np.array([group.size for group in groups])
        n, s = int(sizes.sum()), len(groups)
        inside = math.fsum(float(((group - group.mean()) ** 2).sum()) for group in groups)
        between = math.fsum(float(group.size * (group.mean() - y.mean()) ** 2) for group in groups)
        own = inside / (n - s) if n > s else sampling
        of_starts = 0.0
        if s > 1:
            per_start = (n - float((sizes**2).sum()) / n) / (s - 1)
            of_starts = (between / (s - 1) - own) / per_start
            if of_starts < 0:
                of_starts, own = 0.0, (inside + between) / (n - 1)
        of_iterations = max(own - sampling, 0.0) if n > s else 0.0
        return cls(of_starts, of_iterations, sampling, tuple(sizes.tolist()))

    @property
    def number(self) -> int:
        """N, the iterations."""
        return sum(self.sizes)

    @property
    def by_starts(self) -> float:
        """The part of V that starts have."""
        return self.starts * sum(size**2 for size in self.sizes) / self.number**2

    @property
    def by_iterations(self) -> float:
        """Likewise iterations."""
        return self.iterations / self.number

    @property
    def by_sampling(self) -> float:
        """Likewise messages."""
        return self.sampling / self.number

    @property
    def variance(self) -> float:
        """V."""
        return self.by_starts + self.by_iterations + self.by_sampling


def quantile_scale(ordered: NDArray[np.float64], estimate: float) -> float:
    """One over the density of messages at a percentile: from a share to the unit of the metric.

    Args:
        ordered: all messages, ascending.
        estimate: the percentile, one of them.

    Returns:
        0 where messages are lost within a standard error of the percentile.
    """
    n = ordered.size
    q = int(np.searchsorted(ordered, estimate, side="right")) / n
    error = max(math.sqrt(q * (1 - q) / n), 1 / n)
    low, high = (
        float(ordered[min(max(math.ceil((q + side) * n) - 1, 0), n - 1)])
        for side in (-error, error)
    )
    return (high - low) / (2 * error) if math.isfinite(high - low) else 0.0


def growth_for_mean(distance: float, half: float, freedom: float, confidence: float) -> float:
    """The smallest g with which a mean that is so far from its limit is decided.

    Args:
        distance: d, from the estimate to the limit.
        half: h.
        freedom: of Student's t, by which h follows from u.
        confidence: of each bound.

    Returns:
        Infinity if no g up to 1,000 does it.
    """
    from scipy.special import stdtr

    u = half / t_quantile(freedom, confidence)

    def probability(g: float) -> float:
        h, w = half / math.sqrt(g), u * math.sqrt(1 + 1 / g)
        return 1 - float(stdtr(freedom, (h - distance) / w) - stdtr(freedom, (-h - distance) / w))

    return _smallest_growth(probability) if half > 0 else 1.0


def growth_for_share(bad: float, n: float, allowed: float, confidence: float) -> float:
    """The smallest g with which the test on a share decides.

    Args:
        bad: k / F.
        n: n / F.
        allowed: the share that is tested, above 0.
        confidence: of each bound.

    Returns:
        Infinity if no g up to 1,000 does it.
    """
    from scipy.special import betainc, betaincinv

    shares = betaincinv(bad + 0.5, n - bad + 0.5, (np.arange(_POINTS) + 0.5) / _POINTS)

    def probability(g: float) -> float:
        whole = math.ceil(n * g)

        def passes(k: int) -> bool:
            return upper_bound(k, whole, confidence) <= allowed

        def open_(k: int) -> bool:
            return lower_bound(k, whole, confidence) <= allowed

        passed = failed = np.zeros(_POINTS)
        if passes(0):
            k = last_true(passes, 0, whole)
            passed = betainc(whole - k, k + 1, 1 - shares) if k < whole else passed + 1
        if not open_(whole):
            failed = betainc(k := last_true(open_, 0, whole) + 1, whole - k + 1, shares)
        return float(np.mean(passed + failed))

    return _smallest_growth(probability)


def _smallest_growth(probability: Callable[[float], float]) -> float:
    g = _STEP
    while g <= _MAX_GROWTH:
        if probability(g) >= ASSURANCE:
            return g
        g *= _STEP
    return math.inf


def pieces_for(growth: float, m: int, confidence: float | None) -> int | None:
    """The smallest m' of the module's text, at least m + 1; None if more are needed than proposed.

    Args:
        growth: g.
        m: the present number.
        confidence: c; None where the scatter is not known from the pieces, and t does not count.
    """

    def few(number: int) -> float:
        return 1.0 if confidence is None else t_quantile(max(number - 1, 1), confidence)

    counts = range(m + 1, MAX_PIECES + 1)
    return next(
        (count for count in counts if count / m * (few(m) / few(count)) ** 2 >= growth), None
    )
