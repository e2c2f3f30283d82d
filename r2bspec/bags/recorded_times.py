"""Times of recorded messages: when they were recorded, and the stamps in their headers.

The stamps may be of another clock than the times of recording, or may never have been set.
"""

from __future__ import annotations

import statistics
import struct
from collections import defaultdict
from collections.abc import Collection, Iterable, Mapping
from itertools import compress, pairwise
from pathlib import Path
from typing import Final, Literal, NamedTuple

from r2bspec.bags.bag_reader import read_messages
from r2bspec.bags.message_types import begins_with_header, read_stamp
from r2bspec.bags.recording import BagIndex, DataError, TimeWindow
from r2bspec.bags.storage.storage import open_storages, storage_errors, storage_paths
from r2bspec.language.quantities import Duration
from r2bspec.safe_io.limits import MAX_RECORDED_TIMES, MAX_STAMPS_BYTES

_SECOND_NS: Final = 1_000_000_000
_MOST_BYTES: Final = 256 << 20
_SAMPLE_BYTES: Final = 32 << 20
"""Of the first messages of a large bag, for their stamps."""
_SAME_CLOCK_NS: Final = _SECOND_NS // 2
"""Stamps that differ by more from the times of recording are of another clock."""
_SIMULATED_BEFORE_NS: Final = 315_532_800 * _SECOND_NS
"""Clocks of simulations count from 0; no computer records before 1980."""
_SAME_PACE: Final = 2
"""Times of recording and stamps that last this factor longer or less have the same pace."""
_PAUSE: Final = 5
"""An interval between messages that is longer than the mean one by this factor is a pause."""


class TopicTimes(NamedTuple):
    """The messages of a topic: times of recording and header stamps, in ns.

    There are no stamps if the type has no header, and those of the first messages of a large bag.
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
        """The rate at which the messages were made: that of the stamps, if they tell it.

        A simulation runs at its own pace, which its stamps do not tell.
        """
        is_told = self.is_stamped and self._is_ordered and self.clock != "simulated"
        return _rate_hz(self.stamps_ns if is_told else self.recorded_ns)

    @property
    def _is_ordered(self) -> bool:
        """Whether each stamp is later than the one before."""
        return all(before < after for before, after in pairwise(self.stamps_ns))

    @property
    def _lasts_ns(self) -> tuple[int, int]:
        """The time from the first to the last message, by recording and by stamps.

        Of stamps that are not ordered it is not known.
        """
        stamps_ns = self.stamps_ns if self._is_ordered else []
        recorded_ns = self.recorded_ns[: len(stamps_ns)]
        return (
            recorded_ns[-1] - recorded_ns[0] if recorded_ns else 0,
            stamps_ns[-1] - stamps_ns[0] if stamps_ns else 0,
        )

    @property
    def ahead_ns(self) -> int:
        """How far the stamps are ahead of the times of recording: the median, rounded to 1 ms.

        Stamps that were not set do not count.
        """
        pairs = zip(self.stamps_ns, self.recorded_ns, strict=False)
        ahead_ns = [stamp - recorded for stamp, recorded in pairs if stamp]
        return round(int(statistics.median(ahead_ns)), -6) if ahead_ns else 0

    @property
    def clock(self) -> Literal["same", "stuck", "simulated", "paced", "other", "partly"]:
        """The clock of the stamps, compared with the times of recording.

        They have another pace if a converter wrote its own times, or a recorder those of writing.
        """
        set_ns = [*filter(None, self.stamps_ns)]
        if self.is_stuck:
            return "stuck"
        # A recorder that was started before its clock has first messages of another time.
        if set_ns and abs(statistics.median(set_ns)) < _SIMULATED_BEFORE_NS:
            return "simulated"
        shorter_ns, longer_ns = sorted(self._lasts_ns)
        if longer_ns > _SECOND_NS and longer_ns > _SAME_PACE * shorter_ns:
            return "paced"
        if abs(self.ahead_ns) > _SAME_CLOCK_NS:
            return "other"
        return "partly" if set_ns and len(set_ns) < len(self.stamps_ns) else "same"

    @property
    def clock_text(self) -> str:
        """A clause on the clock, if it is another clock; else empty."""
        count = len(self.stamps_ns)
        all_of = f"all of its {count}" if self.is_stamped else f"its first {count}"
        match self.clock:
            case "stuck" if not self.stamps_ns[0]:
                return f"was never stamped: {all_of} stamps are 0"
            case "stuck":
                return f"has a clock that stands still: {all_of} stamps are the same"
            case "partly":
                return f"was not always stamped: {self.stamps_ns.count(0)} of {count} stamps are 0"
            case "simulated":
                recorded = "" if abs(self.ahead_ns) > _SAME_CLOCK_NS else " and recorded"
                first_s = next(stamp_ns for stamp_ns in self.stamps_ns if stamp_ns) / 1e9
                return f"is stamped{recorded} by a simulated clock, from {first_s:.6g} s"
            case "paced":
                recorded_s, stamped_s = (time_ns / 1e9 for time_ns in self._lasts_ns)
                return f"was recorded in {recorded_s:.4g} s, and stamped over {stamped_s:.4g} s"
            case "other":
                side = "ahead of" if self.ahead_ns > 0 else "behind"
                by = Duration(abs(self.ahead_ns))
                return f"has stamps that are {by} {side} the times of recording"
        return ""


def _rate_hz(times_ns: list[int]) -> float:
    """Return the mean rate without pauses; 0 for fewer than two messages."""
    intervals_ns = [after - before for before, after in pairwise(times_ns)]
    longest_ns = _PAUSE * sum(intervals_ns) / max(1, len(intervals_ns))
    usual_ns = [interval_ns for interval_ns in intervals_ns if interval_ns <= longest_ns]
    return len(usual_ns) * 1e9 / sum(usual_ns) if any(usual_ns) else 0.0


def times_of_bag(path: Path, index: BagIndex) -> dict[str, TopicTimes] | None:
    """Return the times of all messages of a bag as CDR, by topic.

    Of a bag above 64 MiB only the first messages are read: of the others the index of the storage
    tells when they were recorded, but not their stamps. None if the bag cannot be read, has more
    than a million messages, or is large and compressed as a whole.
    """
    most_bytes = _MOST_BYTES if _is_small(path) else _SAMPLE_BYTES
    first = read_times(path, index, index.topics, most_bytes=most_bytes)
    if first is None or all(
        len(found.recorded_ns) == index.topics[topic].count for topic, found in first.items()
    ):
        return first
    if index.compression == "file" or index.message_count > MAX_RECORDED_TIMES:
        return None
    recorded_ns = defaultdict[str, list[int]](list)
    try:
        files = storage_paths(path, index.files)
        with open_storages(files) as storages:
            for file, storage in zip(files, storages, strict=True):
                with storage_errors(file):
                    times = storage.times()
                    if times is None:
                        return None
                    for topic, time_ns in times:
                        recorded_ns[topic].append(int(time_ns))
    except DataError:
        return None
    return {
        topic: TopicTimes(sorted(recorded_ns[topic]), found.stamps_ns)
        for topic, found in first.items()
    }


def _is_small(path: Path) -> bool:
    """Return True if all messages of a bag may be read before a run."""
    try:
        files = [file for file in path.iterdir() if file.is_file()] if path.is_dir() else [path]
        return sum(file.stat().st_size for file in files) <= MAX_STAMPS_BYTES
    except OSError:
        return False


def merged_times(bags: Iterable[Mapping[str, TopicTimes]]) -> dict[str, TopicTimes]:
    """Return the times of several bags together; stamps of a topic of which all are known."""
    merged: dict[str, TopicTimes] = {}
    for bag in bags:
        for topic, added in bag.items():
            known = merged.get(topic)
            if known is None:
                merged[topic] = added
            elif known.is_stamped and added.is_stamped:
                pairs = [*zip(*known, strict=True), *zip(*added, strict=True)]
                recorded_ns, stamps_ns = zip(*sorted(pairs), strict=True) if pairs else ((), ())
                merged[topic] = TopicTimes([*recorded_ns], [*stamps_ns])
            else:
                merged[topic] = TopicTimes(sorted(known.recorded_ns + added.recorded_ns), [])
    return merged


def read_times(
    path: Path,
    index: BagIndex,
    topics: Collection[str],
    window: TimeWindow | None = None,
    most_bytes: int = _MOST_BYTES,
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
            if read_bytes > most_bytes:
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
