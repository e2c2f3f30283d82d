"""How many messages a requirement needs before any outcome of a run can show that it holds.

For the exact binomial test with n messages of which none is on the wrong side, a share of at most
p is shown at confidence c if (1 - p)^n <= 1 - c. Hence, at the least::

    n = ln(1 - c) / ln(1 - p)

which for p99 (p = 1 %) and c = 95 % are 299 messages.
"""

from __future__ import annotations

import math

CONFIDENCE = 0.95


def least_messages(allowed: float, confidence: float = CONFIDENCE) -> int | None:
    """The messages needed to show that at most the share `allowed` is wrong; None for ever."""
    if allowed <= 0 or confidence >= 1:
        return None
    if allowed >= 1:
        return 1
    # A hair less than the quotient, lest a rounding error ask for one message more.
    return max(1, math.ceil(math.log(1 - confidence) / math.log1p(-allowed) - 1e-9))
