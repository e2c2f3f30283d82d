"""Pairing messages whose stamps are near each other but not equal.

Two cameras without a common trigger stamp their images some milliseconds apart. In a graph,
message_filters.ApproximateTimeSynchronizer pairs them; here the same pairs become the steps:

    lead        The input with the fewest messages leads, the first of several. Each of its
                messages can be one step.
    nearest     Every other input gives the message whose stamp is nearest, if the difference is at
                most the slop, and if no other message of the lead is nearer to it. So a message is
                in one step at most, and pairs do not depend on the order of arrival.
    repeated    Of several messages of an input with one stamp, the first belongs to the first of
                another input with this stamp, the second to the second. So a recording whose
                stamps were never set is paired in the order of recording.

A clock that is ahead of the others shows in the times of recording (`clock_ahead`).
"""

from __future__ import annotations

import bisect
import statistics
from collections import Counter
from collections.abc import Sequence
from typing import Final

_Stamp = tuple[int, int]
"""A stamp, and the number of messages of the input before this one that have it."""

LONGEST_DELAY_NS: Final = 500_000_000
"""Messages may be recorded so long after they were stamped, by the same clock."""

_AGREE: Final = 0.8
"""Of the messages, so many agree in how far a clock is ahead."""


def pair_nearest(
    stamps_ns: Sequence[Sequence[int]], slops_ns: Sequence[int]
) -> tuple[tuple[int, ...], ...]:
    """Return, by stamp, the messages of each step: the position of a message of each input.

    Args:
        stamps_ns: the stamps of each input, in the order of its messages.
        slops_ns: the slop of each input; that of a pair is the larger one of its two.
    """
    positions = [_positions(stamp_ns) for stamp_ns in stamps_ns]
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


def _positions(stamps_ns: Sequence[int]) -> dict[_Stamp, int]:
    counts: Counter[int] = Counter()
    positions = {}
    for place, stamp_ns in enumerate(stamps_ns):
        positions[stamp_ns, counts[stamp_ns]] = place
        counts[stamp_ns] += 1
    return positions


def _partner(
    stamp: _Stamp, leads: Sequence[_Stamp], others: Sequence[_Stamp], slop_ns: int
) -> _Stamp | None:
    """Return the stamp among `others` that belongs to this one of the lead.

    None if there is none.
    """
    nearest = _nearest(stamp, others)
    if abs(nearest[0] - stamp[0]) > slop_ns or _nearest(nearest, leads) != stamp:
        return None
    return nearest


def _nearest(stamp: _Stamp, among: Sequence[_Stamp]) -> _Stamp:
    """Return the nearest of some ascending stamps; the earlier one of two that are equally near."""
    after = bisect.bisect_left(among, stamp)
    near = among[max(0, after - 1) : after + 1]
    # Of the messages with these stamps, those with the nearest number.
    numbered = [among[bisect.bisect_right(among, (other[0], stamp[1])) - 1] for other in near]
    return min(numbered, key=lambda other: (abs(other[0] - stamp[0]), abs(other[1] - stamp[1])))


def clock_ahead(
    recorded_ns: Sequence[Sequence[int]], stamps_ns: Sequence[Sequence[int]], slop_ns: int
) -> tuple[int, ...]:
    """Return how far the clock of each input is ahead of the clock that is furthest behind.

    A message and the message of another input that was recorded nearest to it have stamps whose
    difference is that of their clocks, if most pairs agree within half a period.

    Args:
        recorded_ns: the times of recording of each input.
        stamps_ns: the stamps of the same messages.
        slop_ns: differences of clocks up to this are none.

    Returns:
        For each input in ns, to a tenth of a millisecond; all 0 where no constant difference
        explains the stamps.
    """
    lead = min(range(len(recorded_ns)), key=lambda number: len(recorded_ns[number]))
    if len(recorded_ns[lead]) < 3:
        return (0,) * len(recorded_ns)
    period_ns = statistics.median(
        after - before
        for before, after in zip(recorded_ns[lead], recorded_ns[lead][1:], strict=False)
    )
    ahead = []
    for times_ns, stamped_ns in zip(recorded_ns, stamps_ns, strict=True):
        differences = [
            stamped_ns[place] - stamp_ns
            for time_ns, stamp_ns in zip(recorded_ns[lead], stamps_ns[lead], strict=True)
            for place in [_nearest_place(time_ns, times_ns)]
        ]
        middle = round(statistics.median(differences))
        near = sum(abs(difference - middle) <= period_ns / 2 for difference in differences)
        if near < _AGREE * len(differences):
            return (0,) * len(recorded_ns)
        ahead.append(middle)
    behind = min(ahead)
    return tuple(
        round(value - behind, -5) if value - behind > max(slop_ns, period_ns / 2) else 0
        for value in ahead
    )


def _nearest_place(time_ns: int, among: Sequence[int]) -> int:
    after = bisect.bisect_left(among, time_ns)
    places = range(max(0, after - 1), min(len(among), after + 1))
    return min(places, key=lambda place: abs(among[place] - time_ns))
