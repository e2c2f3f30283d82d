"""Times of recorded messages: when they were recorded, and the stamps in their headers.

The stamps may be of another clock than the times of recording, or may never have been set.
"""

from __future__ import annotations

import statistics
import struct
from collections.abc import Collection, Mapping
from itertools import compress, pairwise
from pathlib import Path
from typing import Final, Literal, NamedTuple

import msgspec

from r2bspec.bags.bag_reader import read_messages
from r2bspec.bags.message_types import begins_with_header, read_stamp
from r2bspec.bags.recording import BagIndex, DataError, TimeWindow
from r2bspec.language.quantities import Duration

_SECOND_NS: Final = 1_000_000_000
_MOST_BYTES: Final = 256 << 20
_SAME_CLOCK_NS: Final = _SECOND_NS // 2
"""Stamps that differ by more from the times of recording are of another clock."""
_SIMULATED_BEFORE_NS: Final = 315_532_800 * _SECOND_NS
"""Clocks of simulations count from 0; no computer records before 1980."""
_PAUSE: Final = 5
"""An interval between messages that is longer than the mean one by this factor is a pause."""


class TopicTimes(NamedTuple):
    """The messages of a topic: times of recording and header stamps, in ns.

    There are no stamps if the type has no header.
    """

    recorded_ns: list[int]
    stamps_ns: list[int]

    @property
    def is_stamped(self) -> bool:
        """Whether all messages have a stamp."""
        return len(self.stamps_ns) == len(self.recorded_ns)

    @property
    def is_stuck(self) -> bool:
        """Whether there are several messages whose stamps are all the same, such as 0."""
        return len(self.stamps_ns) > 1 and len(set(self.stamps_ns)) == 1

    @property
    def rate_hz(self) -> float:
        """The mean rate without pauses; 0 for fewer than two messages."""
        intervals_ns = [after - before for before, after in pairwise(self.recorded_ns)]
        longest_ns = _PAUSE * sum(intervals_ns) / max(1, len(intervals_ns))
        usual_ns = [interval_ns for interval_ns in intervals_ns if interval_ns <= longest_ns]
        return len(usual_ns) * 1e9 / sum(usual_ns) if any(usual_ns) else 0.0

    @property
    def ahead_ns(self) -> int:
        """How far the stamps are ahead of the times of recording: the median, rounded to 1 ms.

        Stamps that were not set do not count.
        """
        pairs = zip(self.stamps_ns, self.recorded_ns, strict=False)
        ahead_ns = [stamp - recorded for stamp, recorded in pairs if stamp]
        return round(int(statistics.median(ahead_ns)), -6) if ahead_ns else 0

    @property
    def clock(self) -> Literal["same", "stuck", "simulated", "other", "partly"]:
        """The clock of the stamps, compared with the times of recording."""
        first_ns = next((stamp_ns for stamp_ns in self.stamps_ns if stamp_ns), 0)
        if self.is_stuck:
            return "stuck"
        if 0 < abs(first_ns) < _SIMULATED_BEFORE_NS:
            return "simulated"
        if abs(self.ahead_ns) > _SAME_CLOCK_NS:
            return "other"
        return "partly" if first_ns and not all(self.stamps_ns) else "same"

    @property
    def clock_text(self) -> str:
        """A clause on the clock, if it is another clock; else empty."""
        count = len(self.stamps_ns)
        match self.clock:
            case "stuck" if not self.stamps_ns[0]:
                return f"was never stamped: all of its {count} stamps are 0"
            case "stuck":
                return f"has a clock that stands still: all of its {count} stamps are the same"
            case "partly":
                return f"was not always stamped: {self.stamps_ns.count(0)} of {count} stamps are 0"
            case "simulated":
                recorded = "" if abs(self.ahead_ns) > _SAME_CLOCK_NS else " and recorded"
                first_s = next(stamp_ns for stamp_ns in self.stamps_ns if stamp_ns) / 1e9
                return f"is stamped{recorded} by a simulated clock, from {first_s:.6g} s"
            case "other":
                side = "ahead of" if self.ahead_ns > 0 else "behind"
                by = Duration(abs(self.ahead_ns))
                return f"has stamps that are {by} {side} the times of recording"
        return ""


class RecordedTimes(msgspec.Struct, frozen=True, kw_only=True):
    """The times of a bag, by topic; None if it cannot be read."""

    times: dict[str, TopicTimes] | None


def read_times(
    path: Path, index: BagIndex, topics: Collection[str], window: TimeWindow | None = None
) -> dict[str, TopicTimes] | None:
    """Return the times of the topics that are in the bag as CDR, by these names.

    At most 256 MiB are read. None if the bag or the window cannot be read, which others report.
    """
    infos = {topic: index.find(topic) for topic in topics}
    times = {
        info.name: TopicTimes([], [])
        for info in infos.values()
        if info is not None and info.serialization == "cdr"
    }
    stamped = {name for name in times if begins_with_header(index.topics[name].type)}
    read_bytes = 0
    try:
        for message in read_messages(path, times, window):
            times[message.topic].recorded_ns.append(message.time_ns)
            if message.topic in stamped:
                times[message.topic].stamps_ns.append(read_stamp(message.data))
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


def times_in_window(
    times: Mapping[str, TopicTimes], index: BagIndex, window: TimeWindow
) -> dict[str, TopicTimes]:
    """Return the times of the messages in a window."""
    selected = {}
    for topic, (recorded_ns, stamps_ns) in times.items():
        inside = [window.contains(time_ns - index.start_ns) for time_ns in recorded_ns]
        selected[topic] = TopicTimes(
            [*compress(recorded_ns, inside)], [*compress(stamps_ns, inside)]
        )
    return selected
