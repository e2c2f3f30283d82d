"""How many messages of each bag topic lie in the window, as far as can be told cheaply."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import islice

from r2bspec.check.check_context import Context

_FEW = 5
"""Below this many messages an estimate is worthless, and reading them costs little."""


@dataclass(frozen=True, slots=True)
class Amount:
    """A number of messages; `exact` is False for an estimate from the mean rate."""

    messages: int
    exact: bool


def amounts(context: Context) -> dict[str, Amount]:
    """The messages in the window by the spec's name of the bag topic; only topics of the bag.

    Counts of rendered datasets and of whole bags are exact. Otherwise the mean rate tells; where it
    promises only a few messages, they are looked up.
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
            found[name] = Amount(info.count, exact=True)
        elif context.bag_location is not None and context.bag_location.path is None:
            found[name] = Amount(_rendered(bag.name, info.name, start_ns, end_ns), exact=True)
        else:
            length_s = (min(end_ns, bag.duration_ns) - start_ns) / 1e9
            estimate = round(info.rate_hz * max(length_s, 0))
            found[name] = (
                _looked_up(context, info.name) if estimate < _FEW else Amount(estimate, exact=False)
            )
    return found


def _rendered(name: str, topic: str, start_ns: int, end_ns: int) -> int:
    from r2bspec.bags.errors import DataError
    from r2bspec.bags.recording import Window
    from r2bspec.datasets.sequences import describe

    try:
        index = describe(name, {topic}, Window(start_ns=start_ns, end_ns=end_ns))
    except DataError:
        return 0
    return index.message_count


def _looked_up(context: Context, topic: str) -> Amount:
    """Count by reading, and stop at a few."""
    from r2bspec.bags.bag_reader import read_messages
    from r2bspec.bags.errors import DataError
    from r2bspec.bags.recording import Window

    window = context.spec.data_loader.window
    path = context.bag_location.path if context.bag_location is not None else None
    if path is None:
        # Of several bags nothing is read; a rendered one is counted without reading.
        return Amount(_FEW, exact=False)
    wanted = Window(start_ns=window.start.ns, end_ns=window.end.ns if window.end else None)
    try:
        seen = sum(1 for _ in islice(read_messages(path, {topic}, wanted), _FEW))
    except DataError:
        # What cannot be read, or a window outside of the bag, is reported by rules of their own.
        return Amount(_FEW, exact=False)
    return Amount(seen, exact=seen < _FEW)
