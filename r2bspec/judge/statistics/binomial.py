"""The exact binomial test on a share, and its confidence bounds.

Of n messages, k are over a bound; the share p of all messages that are over is unknown, and k is
binomial(n, p) if messages are independent. One-sided tests at the level alpha = 1 - confidence
against an allowed share p0:

    p <= p0 is shown if    P(X <= k | p0) <= alpha        (so few would be a surprise at p0)
    p >  p0 is shown if    P(X >= k | p0) <= alpha        (so many would be a surprise at p0)

Neither can be wrong in more than a share alpha of all runs, and both cannot hold at once for
alpha < 1/2. The Clopper-Pearson bounds are the same tests turned round: the upper bound is the
largest p, the lower bound the smallest, that k does not contradict.

Messages that are not independent have a smaller effective sample size, and neither k nor n need be
whole then (`shares`). The binomial distribution function is an incomplete beta
function,

    P(X <= k | p) = I_(1-p)(n - k, k + 1)        P(X >= k | p) = I_p(k, n - k + 1),

which is defined between whole numbers as well, and is used there.
"""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Callable


def upper_bound(k: float, n: float, confidence: float) -> float:
    """Return the one-sided upper Clopper-Pearson bound: the p with P(X <= k | p) = 1 - confidence.

    It is the `confidence` quantile of Beta(k + 1, n - k), and 1 for k = n.
    """
    if k >= n:
        return 1.0
    from scipy.special import betaincinv

    return float(betaincinv(k + 1, n - k, confidence))


def lower_bound(k: float, n: float, confidence: float) -> float:
    """Return the one-sided lower Clopper-Pearson bound: the p with P(X >= k | p) = 1 - confidence.

    It is the 1 - `confidence` quantile of Beta(k, n - k + 1), and 0 for k = 0.
    """
    if k <= 0:
        return 0.0
    from scipy.special import betaincinv

    return float(betaincinv(k, n - k + 1, 1 - confidence))


def last_true(holds: Callable[[int], bool], low: int, high: int) -> int:
    """Return the largest k in low..high with `holds(k)`, which is true up to some k only.

    `holds(low)` must be true.
    """
    return low + bisect_left(range(low + 1, high + 1), True, key=lambda k: not holds(k))
