"""Matching the messages of several topics that carry the same stamp."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any


class StampSets:
    """Keeps each message until every other topic has one with the same stamp.

    Sets are returned in the order in which they become complete. Each topic keeps at most `depth`
    messages; then its oldest one is discarded.

    Attributes:
        discarded: the number of messages that were discarded, or replaced by another one of the
            same topic with the same stamp.
    """

    def __init__(self, topics: Sequence[str], depth: int) -> None:
        self.discarded = 0
        self._depth = depth
        self._waiting: dict[str, dict[int, Any]] = {topic: {} for topic in topics}

    def add(self, topic: str, stamp_ns: int, message: Any) -> tuple[Any, ...] | None:
        """Take a message; return the set that it completes, in the order of the topics, if any."""
        others = [waiting for name, waiting in self._waiting.items() if name != topic]
        own = self._waiting[topic]
        if own.pop(stamp_ns, None) is not None:
            self.discarded += 1
        own[stamp_ns] = message
        if all(stamp_ns in other for other in others):
            return tuple(waiting.pop(stamp_ns) for waiting in self._waiting.values())
        if len(own) > self._depth:
            # A dict keeps the order of insertion, so its first key has waited longest.
            del own[next(iter(own))]
            self.discarded += 1
        return None
