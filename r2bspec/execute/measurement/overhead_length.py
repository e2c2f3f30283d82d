"""How many messages the measurement of the harness overhead takes.

Its median is known once a distribution-free confidence interval of it is narrow: of n independent
values, the median of their distribution lies between the k-th smallest and the k-th largest with
probability 1 - 2 P(B < k), where B is binomial with n and 1/2 (David and Nagaraja, Order
Statistics, 7.1). For 11 values and k = 2 this is 98.8 %.

Its 99th percentile is bounded by the largest of n values with probability 1 - 0.99^n: 299 values
are enough for 95 %. Of fewer than 100 values, the largest is also what is reported as the 99th
percentile (nearest rank), which says what to expect, and not how likely more is.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

from r2bspec.record.sample_arrays import Rows

_P99_MESSAGES: Final = math.ceil(math.log(0.05) / math.log(0.99))
_FEWEST: Final = 11
_FEW: Final = 20
_MOST: Final = 2000
_ERROR: Final = 0.02
"""How often the median may lie outside its interval."""

_NARROW: Final = 0.25
"""How far the ends of the interval may be from the median, as a share of it."""


class OverheadLength(NamedTuple):
    """After how many messages the measurement may end, and after how many it does."""

    fewest: int
    most: int


def overhead_length(usual: int) -> OverheadLength:
    """The length for a rate.

    Args:
        usual: how many messages a second has, or as much of one as the recording.
    """
    if usual < _FEW:
        # Below 20 Hz a second has too few; each further one takes long.
        return OverheadLength(_FEWEST, _FEW)
    most = min(usual, _MOST)
    return OverheadLength(min(most, _P99_MESSAGES), most)


def median_is_known(values: Rows) -> bool:
    """Whether the interval of the median is narrow; never for too few values to have one."""
    rank = _rank(len(values))
    if not rank:
        return False
    ordered = sorted(values)
    middle = ordered[len(ordered) // 2]
    allowed = _NARROW * abs(middle)
    return bool(ordered[-rank] - middle <= allowed and middle - ordered[rank - 1] <= allowed)


def _rank(count: int) -> int:
    """The largest k of the interval from the k-th smallest to the k-th largest; 0 for none."""
    rank, below = 0, 0
    allowed = _ERROR / 2 * 2**count
    while (below := below + math.comb(count, rank)) <= allowed:
        rank += 1
    return rank
