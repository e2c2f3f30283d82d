"""How many more starts, iterations or pairs would decide an open requirement.

The estimate and the scatter are assumed to stay the same. Then m' pieces instead of m reduce the
half width of an interval by t by the factor

    t_c(m' - 1) / t_c(m - 1) sqrt(m / m'),

and counts larger by m' / m. The smallest m' with which the test decides is about right in one run
of two: the next pieces are other pieces.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Final

from r2bspec.judge.statistics.binomial import lower_bound, upper_bound
from r2bspec.judge.statistics.t_interval import t_quantile

MAX_PIECES: Final = 400
"""More pieces in all are not proposed."""

Decides = Callable[[int], bool]
"""Whether so many pieces in all would decide."""


def mean_decides(distance: float, half: float, m: int, confidence: float) -> Decides:
    """Return the test whether m' pieces narrow an interval of m pieces enough.

    Args:
        distance: from the estimate to the limit.
        half: half width of the interval of m pieces.
        m: at least 2.
        confidence: the confidence of each bound.
    """
    quantile = t_quantile(m - 1, confidence)
    return lambda more: (
        half * t_quantile(more - 1, confidence) / quantile * math.sqrt(m / more) < distance
    )


def share_decides(bad: float, n: float, allowed: float, m: int, confidence: float) -> Decides:
    """Return the test whether m' pieces have enough messages for the test on a share.

    Args:
        bad: bad messages of m pieces, over the design effect.
        n: messages of m pieces, likewise.
        allowed: the share that is tested.
        m: at least 1.
        confidence: the confidence of each bound.
    """

    def decides(more: int) -> bool:
        counts = bad * more / m, n * more / m, confidence
        return upper_bound(*counts) <= allowed or lower_bound(*counts) > allowed

    return decides


def more_pieces(m: int, *decides: Decides) -> int | None:
    """Return how many pieces have to be added to m; None if more are needed than proposed."""
    enough = (more for more in range(m + 1, MAX_PIECES + 1) if all(test(more) for test in decides))
    pieces = next(enough, None)
    return pieces - m if pieces is not None else None


def advice(more: int, pieces: str) -> str:
    """Return the advice as a sentence; `pieces` is the noun for what is added, in the plural."""
    return f"About {more} more {pieces if more > 1 else pieces[:-1]} would decide it."
