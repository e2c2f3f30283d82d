"""Times of recorded messages: when they were recorded, and the stamps in their headers.

The stamps may be of another clock than the times of recording, or may never have been set.
"""

from __future__ import annotations

import statistics
import struct
from collections.abc import Collection
from pathlib import Path
from typing import Final, Literal, NamedTuple

from r2bspec.bags.bag_reader import read_messages
from r2bspec.bags.message_types import begins_with_header
from r2bspec.bags.recording import BagIndex, DataError, TimeWindow
from r2bspec.language.quantities import Duration

_STAMP: Final = {True: struct.Struct("<iI"), False: struct.Struct(">iI")}
_STAMP_AT: Final = 4
_SECOND_NS: Final = 1_000_000_000
_MOST_BYTES: Final = 256 << 20
_SAME_CLOCK_NS: Final = _SECOND_NS // 2
"""Stamps that differ by more from the times of recording are of another clock."""
_SIMULATED_BEFORE_NS: Final = 315_532_800 * _SECOND_NS
"""Clocks of simulations count from 0; no computer records before 1980."""


class TopicTimes(NamedTuple):
    """The messages of a topic: times of recording and header stamps, in ns."""

    recorded_ns: list[int]
    stamps_ns: list[int]

    @property
    def never_stamped(self) -> bool:
        """Whether there are several messages, and all of their stamps are 0."""
        return len(self.stamps_ns) > 1 and not any(self.stamps_ns)

    @property
    def ahead_ns(self) -> int:
        """How far the stamps are ahead of the times of recording: the median, to a millisecond."""
        pairs = zip(self.stamps_ns, self.recorded_ns, strict=True)
        return round(int(statistics.median(stamp - recorded for stamp, recorded in pairs)), -6)

    @property
    def clock(self) -> Literal["same", "unset", "simulated", "other"]:
        """Which clock the stamps are of, compared with the times of recording."""
        if not self.stamps_ns:
            return "same"
        if self.never_stamped:
            return "unset"
        if abs(self.stamps_ns[0]) < _SIMULATED_BEFORE_NS:
            return "simulated"
        return "other" if abs(self.ahead_ns) > _SAME_CLOCK_NS else "same"

    @property
    def clock_text(self) -> str:
        """What is said of another clock; empty for the same."""
        match self.clock:
            case "unset":
                return f"was never stamped: all of its {len(self.stamps_ns)} stamps are 0"
            case "simulated":
                recorded = "" if abs(self.ahead_ns) > _SAME_CLOCK_NS else " and recorded"
                first_s = self.stamps_ns[0] / 1e9
                return f"is stamped{recorded} by a simulated clock, from {first_s:.6g} s"
            case "other":
                side = "ahead of" if self.ahead_ns > 0 else "behind"
                by = Duration(abs(self.ahead_ns))
                return f"has stamps that are {by} {side} the times of recording"
        return ""


def read_times(
    path: Path, index: BagIndex, topics: Collection[str], window: TimeWindow | None = None
) -> dict[str, TopicTimes] | None:
    """Return the times of the topics whose messages have a header, by these names.

    At most 256 MiB are read. None if a topic is not in the bag, or the bag or the window cannot be
    read, which others report.
    """
    infos = {topic: index.find(topic) for topic in topics}
    times = {
        info.name: TopicTimes([], [])
        for info in infos.values()
        if info is not None and begins_with_header(info.type) and info.serialization == "cdr"
    }
    read_bytes = 0
    try:
        for message in read_messages(path, times, window):
            stamp = _STAMP[bool(message.data[1] & 1)]
            seconds, nanoseconds = stamp.unpack_from(message.data, _STAMP_AT)
            times[message.topic].recorded_ns.append(message.time_ns)
            times[message.topic].stamps_ns.append(seconds * _SECOND_NS + nanoseconds)
            read_bytes += len(message.data)
            if read_bytes > _MOST_BYTES:
                break
    except (DataError, struct.error, IndexError):
        return None
    return {
        topic: times[info.name]
        for topic, info in infos.items()
        if info is not None and info.name in times
    }
