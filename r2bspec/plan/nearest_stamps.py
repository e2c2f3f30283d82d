"""Pairing messages whose stamps are near each other but not equal.

Two cameras without a common trigger stamp their images some milliseconds apart. In a graph,
message_filters.ApproximateTimeSynchronizer pairs them; here the same pairs become the steps:

    lead        The input with the fewest messages leads, the first of several. Each of its
                messages can be one step.
    nearest     Every other input gives the message whose stamp is nearest, if the difference is at
                most the slop, and if no other message of the lead is nearer to it. So a message is
                in one step at most, and pairs do not depend on the order of arrival.
"""

from __future__ import annotations

import bisect
from collections.abc import Sequence


def pair_nearest(
    stamps_ns: Sequence[Sequence[int]], slops_ns: Sequence[int]
) -> tuple[tuple[int, ...], ...]:
    """The messages of each step: the position of one message for each input, ordered by stamp.

    Of several messages of an input with one stamp, the last one is used.

    Args:
        stamps_ns: the stamps of each input, in the order of its messages.
        slops_ns: the slop of each input; that of a pair is the larger one of its two.
    """
    positions = [{stamp: place for place, stamp in enumerate(stamp_ns)} for stamp_ns in stamps_ns]
    ordered = [sorted(position) for position in positions]
    lead = min(range(len(ordered)), key=lambda number: len(ordered[number]))
    groups = []
    for stamp in ordered[lead]:
        members = [
            stamp
            if number == lead
            else _partner(stamp, ordered[lead], others, max(slops_ns[lead], slops_ns[number]))
            for number, others in enumerate(ordered)
        ]
        step = [
            places[stamps]
            for places, stamps in zip(positions, members, strict=True)
            if stamps is not None
        ]
        if len(step) == len(members):
            groups.append(tuple(step))
    return tuple(groups)


def _partner(stamp: int, leads: Sequence[int], others: Sequence[int], slop_ns: int) -> int | None:
    """The stamp among `others` that belongs to this one of the lead; None if there is none."""
    nearest = _nearest(stamp, others)
    if abs(nearest - stamp) > slop_ns or _nearest(nearest, leads) != stamp:
        return None
    return nearest


def _nearest(stamp: int, among: Sequence[int]) -> int:
    """The nearest of some ascending stamps; the earlier one of two that are equally near."""
    place = bisect.bisect_left(among, stamp)
    return min(among[max(0, place - 1) : place + 1], key=lambda each: abs(each - stamp))
