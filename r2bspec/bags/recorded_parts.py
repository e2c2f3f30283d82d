"""Recordings with a gap, of which one part is meant.

A recorder that was started before the clock of a simulation, or before the clock of the machine was
set, records a few messages at another time than the rest. The rates and the length of such a
recording mean nothing; those of its larger part do.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Final

from msgspec.structs import replace

from r2bspec.bags.bag_reader import may_be_read, read_messages
from r2bspec.bags.recording import BagIndex, DataError, TimeWindow, TopicInfo

_SHORTEST_GAP_NS: Final = 10_000_000_000
_MILLISECOND_NS: Final = 1_000_000


@dataclass(frozen=True)
class RecordedParts:
    """A gap that is longer than all that was recorded before and after it.

    Attributes:
        gap_ns: its length.
        after_ns: where it begins, in ns after the start of the recording.
        window: the part with more messages, at most a millisecond longer.
        count: the messages of that part.
        total: those of the recording.
        larger: the index of that part.
    """

    gap_ns: int
    after_ns: int
    window: TimeWindow
    count: int
    total: int
    larger: BagIndex

    @property
    def text(self) -> str:
        """The gap, without a full stop."""
        return (
            f"a gap of {_rounded(self.gap_ns)}, and {self.count:,} of its {self.total:,} messages "
            f"{'after it' if self.window.start_ns > self.after_ns else 'before it'}"
        )

    @property
    def window_text(self) -> str:
        """The window of the larger part, as a spec has it."""
        ends = "" if self.window.end_ns is None else f", end: {_exact(self.window.end_ns)}"
        return f"window: {{start: {_exact(self.window.start_ns)}{ends}}}"


def _exact(time_ns: int) -> str:
    return f"{time_ns // _MILLISECOND_NS / 1000:.12g} s"


def _rounded(time_ns: int) -> str:
    return f"{time_ns / 1e9:.4g} s"


def find_parts(
    path: Path,
    index: BagIndex,
    topics: Collection[str] | None = None,
    window: TimeWindow | None = None,
) -> RecordedParts | None:
    """Return the parts of a recording with a gap; None without a gap, or if it is not read.

    Recordings above 64 MiB are not read, nor those that cannot be read.

    Args:
        path: of the bag.
        index: its index.
        topics: whose messages are looked at; None for all.
        window: only what lies in it.
    """
    if index.duration_ns < _SHORTEST_GAP_NS or not may_be_read(path):
        return None
    if topics is None:
        topics = [name for name, info in index.topics.items() if info.serialization == "cdr"]
    try:
        messages = [
            (message.time_ns, message.topic) for message in read_messages(path, topics, window)
        ]
    except DataError:
        return None
    gaps = [
        (after[0] - before[0], number)
        for number, (before, after) in enumerate(pairwise(messages), start=1)
    ]
    gap_ns, begin = max(gaps, default=(0, 0))
    if gap_ns < _SHORTEST_GAP_NS or 2 * gap_ns < messages[-1][0] - messages[0][0]:
        return None
    before, after = messages[:begin], messages[begin:]
    larger = max(after, before, key=len)
    if larger is after:
        start_ns = (after[0][0] - index.start_ns) // _MILLISECOND_NS * _MILLISECOND_NS
        part = TimeWindow(start_ns=start_ns, end_ns=window.end_ns if window else None)
    else:
        end_ns = -(-(before[-1][0] + 1 - index.start_ns) // _MILLISECOND_NS) * _MILLISECOND_NS
        part = TimeWindow(start_ns=window.start_ns if window else 0, end_ns=end_ns)
    return RecordedParts(
        gap_ns=gap_ns,
        after_ns=before[-1][0] - index.start_ns,
        window=part,
        count=len(larger),
        total=len(messages),
        larger=_index_of(index, larger),
    )


def _index_of(index: BagIndex, messages: list[tuple[int, str]]) -> BagIndex:
    counts = Counter(topic for _, topic in messages)
    first_ns = {topic: time_ns for time_ns, topic in reversed(messages)}
    last_ns = {topic: time_ns for time_ns, topic in messages}

    def topic_of(info: TopicInfo) -> TopicInfo:
        count = counts[info.name]
        lasts_s = (last_ns[info.name] - first_ns[info.name]) / 1e9 if count else 0.0
        return replace(
            info,
            count=count,
            rate_hz=(count - 1) / lasts_s if lasts_s else 0.0,
            first_ns=first_ns.get(info.name),
            last_ns=last_ns.get(info.name),
        )

    return replace(
        index,
        topics={name: topic_of(info) for name, info in index.topics.items()},
        start_ns=messages[0][0],
        end_ns=messages[-1][0],
        message_count=len(messages),
    )
