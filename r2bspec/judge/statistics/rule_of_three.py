"""What a sample without a failure proves, in closed form, without SciPy.

If a share p of all messages is over a bound, n independent messages show none with probability (1 -
p)^n. So after n messages with none over, p is at most the p for which that is 1 - c:

    (1 - p)^n = 1 - c        p = 1 - (1 - c)^(1/n)        n = ln(1 - c) / ln(1 - p)

at the confidence c. This is the Clopper-Pearson bound for k = 0.
"""

from __future__ import annotations

import math


def zero_failure_bound(n: int, confidence: float) -> float:
    """Return the upper bound on the share of failures after n messages without a failure.

    At 95 % it is close to 3/n, the rule of three, because -ln 0.05 = 2.996.

    Args:
        n: at least 1.
        confidence: between 0 and 1.
    """
    return -math.expm1(math.log1p(-confidence) / n)


def min_sample_size(max_share: float, confidence: float) -> int | None:
    """Return the fewest messages, none over the bound, that prove a share of at most `max_share`.

    For p99 (1 %) and p90 (10 %) they are 299 and 29 at 95 %, 459 and 44 at 99 %.

    Returns:
        None if no number of messages is enough.
    """
    if max_share <= 0 or confidence >= 1:
        return None
    if max_share >= 1:
        return 1
    # 0.9 is not exact in binary: a number that is whole but for rounding is taken as whole.
    return max(1, math.ceil(math.log1p(-confidence) / math.log1p(-max_share) - 1e-9))
