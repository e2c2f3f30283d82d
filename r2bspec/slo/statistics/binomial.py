"""The exact binomial test on a share, its confidence bounds, and its critical counts.

Of n messages, k are over a bound; the share p of all messages that are over is unknown, and k is
binomial(n, p) if messages are independent. One-sided tests at the level alpha = 1 - confidence
against an allowed share p0:

    p <= p0 is shown if    P(X <= k | p0) <= alpha        (so few would be a surprise at p0)
    p >  p0 is shown if    P(X >= k | p0) <= alpha        (so many would be a surprise at p0)

Neither can be wrong in more than a share alpha of all runs, and both cannot hold at once for
alpha < 1/2. The Clopper-Pearson bounds are the same tests turned round: the upper bound is the
largest p, the lower bound the smallest, that k does not contradict.
"""

from __future__ import annotations

import math
from collections.abc import Callable


def upper_bound(k: int, n: int, confidence: float) -> float:
    """The one-sided upper Clopper-Pearson bound: the p with P(X <= k | p) = 1 - confidence.

    It is the `confidence` quantile of Beta(k + 1, n - k), and 1 for k = n.
    """
    if k >= n:
        return 1.0
    from scipy.special import betaincinv

    return float(betaincinv(k + 1, n - k, confidence))


def lower_bound(k: int, n: int, confidence: float) -> float:
    """The one-sided lower Clopper-Pearson bound: the p with P(X >= k | p) = 1 - confidence.

    It is the 1 - `confidence` quantile of Beta(k, n - k + 1), and 0 for k = 0.
    """
    if k <= 0:
        return 0.0
    from scipy.special import betaincinv

    return float(betaincinv(k, n - k + 1, 1 - confidence))


def most_to_pass(n: int, allowed: float, confidence: float) -> int | None:
    """The largest k for which n messages show a share of at most `allowed`; None if not even 0.

    That is the largest k with P(X <= k | allowed) <= 1 - confidence.
    """
    from scipy.special import bdtr

    alpha = 1 - confidence

    def shows(k: int) -> bool:
        return float(bdtr(k, n, allowed)) <= alpha

    if n < 1 or not shows(0):
        return None
    return _last_true(shows, 0, n)


def least_to_fail(n: int, allowed: float, confidence: float) -> int | None:
    """The smallest k for which n messages show a share above `allowed`; None if not even n.

    That is the smallest k with P(X >= k | allowed) <= 1 - confidence.
    """
    from scipy.special import bdtrc

    alpha = 1 - confidence

    def undecided(k: int) -> bool:
        # bdtrc is P(X > k), so P(X >= k) is bdtrc(k - 1); P(X >= 0) is certain.
        return k == 0 or float(bdtrc(k - 1, n, allowed)) > alpha

    if n < 1 or undecided(n):
        return None
    return _last_true(undecided, 0, n) + 1


def _last_true(holds: Callable[[int], bool], low: int, high: int) -> int:
    """The largest k in low..high that holds, where every k up to some one holds and none after.

    `low` must hold.
    """
    while low < high:
        middle = (low + high + 1) // 2
        if holds(middle):
            low = middle
        else:
            high = middle - 1
    return low


def messages_to_settle(share: float, allowed: float, confidence: float, most: int) -> int | None:
    """About how many messages decide for or against `allowed`, if a share `share` stays over.

    The smallest n of a geometric series (steps of 5 %) at which the test with k = round(n share)
    decides. A forecast, for the reader who asks how much longer to run, and no part of a test.

    Returns:
        None if more than `most` are needed: the share is too close to what is allowed.
    """
    n = 10.0
    while n <= most:
        whole = math.ceil(n)
        k = round(whole * share)
        if upper_bound(k, whole, confidence) <= allowed:
            return whole
        if lower_bound(k, whole, confidence) > allowed:
            return whole
        n *= 1.05
    return None
