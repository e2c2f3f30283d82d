"""How many messages a requirement needs before any outcome of a run can show that it holds.

For the exact binomial test with n messages of which none is on the wrong side, a share of at most
p is shown at confidence c if (1 - p)^n <= 1 - c. Hence, at the least::

    n = ln(1 - c) / ln(1 - p)

which for p99 (p = 1 %) and c = 95 % are 299 messages.
"""

from __future__ import annotations

import math

DEFAULT_CONFIDENCE = 0.95


def min_sample_size(max_share: float, confidence: float = DEFAULT_CONFIDENCE) -> int | None:
    """The messages needed to show that at most the share `max_share` is wrong; None for ever."""
    if max_share <= 0 or confidence >= 1:
        return None
    if max_share >= 1:
        return 1
    # A hair less than the quotient, lest a rounding error ask for one message more.
    return max(1, math.ceil(math.log(1 - confidence) / math.log1p(-max_share) - 1e-9))
