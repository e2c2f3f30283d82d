"""Recordings with a gap, of which only one part is wanted.

A recorder that was started before the clock of a simulation, or before the clock of the machine was
set, records a few messages at another time than the rest. The rates and the length of such a
recording mean nothing; those of its larger part do.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise
from typing import Final

from msgspec.structs import replace

from r2bspec.bags.offered_qos import is_latched
from r2bspec.bags.recorded_times import TopicTimes
from r2bspec.bags.recording import BagIndex, TimeWindow, TopicInfo
from r2bspec.language.quantities import Duration

_SHORTEST_GAP_NS: Final = 10_000_000_000
_MILLISECOND_NS: Final = 1_000_000


@dataclass(frozen=True)
class RecordedParts:
    """A recording with gaps, each longer than all that was recorded before and after it.

    Attributes:
        gaps_ns: the lengths of the gaps. The first gap is the longest; each further gap is in the
            larger part of the recording that the gap before it leaves.
        is_after: whether the larger part is after the first gap.
        window: the part with more messages, at most a millisecond longer.
        total: the number of messages of the recording.
        larger: the index of that part, and of latched topics that were recorded before it.
        count: the number of messages of that part.
    """

    gaps_ns: tuple[int, ...]
    is_after: bool
    window: TimeWindow
    total: int
    larger: BagIndex
    count: int

    @property
    def text(self) -> str:
        """The gaps, without a full stop."""
        shares = f"{self.count:,} of its {self.total:,} messages"
        if len(self.gaps_ns) > 1:
            gaps = " and ".join(_rounded(gap_ns) for gap_ns in self.gaps_ns)
            return f"gaps of {gaps}, and {shares} in one piece"
        side = "after it" if self.is_after else "before it"
        return f"a gap of {_rounded(self.gaps_ns[0])}, and {shares} {side}"

    @property
    def window_text(self) -> str:
        """The window of the larger part, as a spec has it."""
        ends = "" if self.window.end_ns is None else f", end: {Duration(self.window.end_ns)}"
        return f"window: {{start: {Duration(self.window.start_ns)}{ends}}}"


def _rounded(time_ns: int) -> str:
    return f"{time_ns / 1e9:.4g} s"


def find_parts(
    index: BagIndex, times: Mapping[str, TopicTimes], window: TimeWindow | None = None
) -> RecordedParts | None:
    """Return the parts of a recording with a gap; None without a gap.

    Args:
        index: the index of the recording.
        times: the times of the topics that are looked at, as far as they are in the window.
        window: only what lies in it; None for everything.
    """
    messages = sorted(
        (time_ns, topic) for topic, each in times.items() for time_ns in each.recorded_ns
    )
    total, part = len(messages), window or TimeWindow()
    gaps_ns: list[int] = []
    is_after = False
    while (place := _gap(messages)) is not None:
        before, after = messages[:place], messages[place:]
        gaps_ns.append(after[0][0] - before[-1][0])
        messages = max(after, before, key=len)
        if messages is after:
            start_ns = (after[0][0] - index.start_ns) // _MILLISECOND_NS * _MILLISECOND_NS
            part = replace(part, start_ns=start_ns)
        else:
            end_ns = -(-(before[-1][0] + 1 - index.start_ns) // _MILLISECOND_NS) * _MILLISECOND_NS
            part = replace(part, end_ns=end_ns)
        is_after = is_after if gaps_ns[1:] else messages is after
    if not gaps_ns:
        return None
    larger = _index_of(index, messages)
    return RecordedParts(tuple(gaps_ns), is_after, part, total, larger, len(messages))


def _gap(messages: list[tuple[int, str]]) -> int | None:
    """Return the place after a gap that is longer than the rest; None without such a gap."""
    gaps = [
        (after[0] - before[0], place)
        for place, (before, after) in enumerate(pairwise(messages), start=1)
    ]
    gap_ns, place = max(gaps, default=(0, 0))
    if gap_ns < _SHORTEST_GAP_NS or 2 * gap_ns < messages[-1][0] - messages[0][0]:
        return None
    return place


def _index_of(index: BagIndex, messages: list[tuple[int, str]]) -> BagIndex:
    counts = Counter(topic for _, topic in messages)
    first_ns = {topic: time_ns for time_ns, topic in reversed(messages)}
    last_ns = {topic: time_ns for time_ns, topic in messages}

    def topic_of(info: TopicInfo) -> TopicInfo:
        count = counts[info.name]
        is_before = info.last_ns is not None and info.last_ns < messages[0][0]
        is_kept = is_latched(info.qos) or info.name.lstrip("/") == "tf_static"
        if is_before and (info.count == 1 or is_kept):
            # It can be published once, from before the window.
            return info
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
