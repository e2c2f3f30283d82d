"""The number of messages of each bag topic in the window, at low cost."""

from __future__ import annotations

from functools import cache
from itertools import islice

import msgspec

from r2bspec.check.check_context import Context

_MIN_ESTIMATED_MESSAGES = 5
"""Below this number an estimate is useless, and reading the messages is cheap."""


class MessageCount(msgspec.Struct, frozen=True):
    """A number of messages; `exact` is False for an estimate from the mean rate."""

    messages: int
    exact: bool


def window_message_counts(context: Context) -> dict[str, MessageCount]:
    """The messages in the window of each loaded topic that the bag contains.

    Counts of rendered datasets and of whole bags are exact. Other counts are estimated from the
    mean rate; if the estimate is low, the messages are read.
    """
    bag = context.bag
    if bag is None:
        return {}
    window = context.spec.data_loader.window
    start_ns = window.start.ns
    end_ns = bag.duration_ns + 1 if window.end is None else window.end.ns
    found = {}
    for name in context.spec.data_loader.topics:
        info = bag.find(name)
        if info is None:
            continue
        if start_ns == 0 and end_ns > bag.duration_ns:
            found[name] = MessageCount(info.count, exact=True)
        elif context.bag_location is not None and context.bag_location.path is None:
            found[name] = MessageCount(
                _count_rendered(bag.name, info.name, start_ns, end_ns), exact=True
            )
        else:
            length_s = (min(end_ns, bag.duration_ns) - start_ns) / 1e9
            estimate = round(info.rate_hz * max(length_s, 0))
            found[name] = (
                _count_by_reading(context, info.name)
                if estimate < _MIN_ESTIMATED_MESSAGES
                else MessageCount(estimate, exact=False)
            )
    return found


@cache  # of a pure function: the catalogue and its datasets do not change
def _count_rendered(name: str, topic: str, start_ns: int, end_ns: int) -> int:
    from r2bspec.bags.recording import DataError, Window
    from r2bspec.datasets.catalogue import describe

    try:
        index = describe(name, {topic}, Window(start_ns=start_ns, end_ns=end_ns))
    except DataError:
        return 0
    return index.message_count


def _count_by_reading(context: Context, topic: str) -> MessageCount:
    """Count by reading, up to _MIN_ESTIMATED_MESSAGES."""
    from r2bspec.bags.bag_reader import read_messages
    from r2bspec.bags.recording import DataError, Window

    window = context.spec.data_loader.window
    path = context.bag_location.path if context.bag_location is not None else None
    if path is None:
        # Several bags are not read; a rendered one is counted without reading.
        return MessageCount(_MIN_ESTIMATED_MESSAGES, exact=False)
    wanted = Window(start_ns=window.start.ns, end_ns=window.end.ns if window.end else None)
    try:
        counted = sum(
            1 for _ in islice(read_messages(path, {topic}, wanted), _MIN_ESTIMATED_MESSAGES)
        )
    except DataError:
        # Other rules report unreadable bags and windows outside of the bag.
        return MessageCount(_MIN_ESTIMATED_MESSAGES, exact=False)
    return MessageCount(counted, exact=counted < _MIN_ESTIMATED_MESSAGES)
