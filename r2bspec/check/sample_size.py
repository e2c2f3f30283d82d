"""The minimum number of messages with which a run can confirm a requirement.

By the exact binomial test, n messages without a violation confirm a share of violations of at most
p at confidence c if (1 - p)^n <= 1 - c. The minimum is therefore::

    n = ln(1 - c) / ln(1 - p)

For p99 (p = 1 %) and c = 95 % it is 299 messages.
"""

from __future__ import annotations

import math

DEFAULT_CONFIDENCE = 0.95


def min_sample_size(max_share: float, confidence: float = DEFAULT_CONFIDENCE) -> int | None:
    """The messages needed to confirm a share of at most `max_share`; None if no number does."""
    if max_share <= 0 or confidence >= 1:
        return None
    if max_share >= 1:
        return 1
    # Slightly less than the quotient, so that a rounding error does not add a message.
    return max(1, math.ceil(math.log(1 - confidence) / math.log1p(-max_share) - 1e-9))
