"""Matching the messages of two topics that carry the same stamp."""

from __future__ import annotations

from typing import Generic, TypeVar

A = TypeVar("A")
B = TypeVar("B")
T = TypeVar("T")


class StampPairs(Generic[A, B]):
    """Keeps each message until the message of the other topic with the same stamp arrives.

    Pairs are returned in the order in which they become complete. Each side keeps at most `depth`
    messages; then the oldest is discarded.

    Attributes:
        discarded: the number of messages that were discarded, or replaced by another one with the
            same stamp.
    """

    def __init__(self, depth: int) -> None:
        self.discarded = 0
        self._depth = depth
        self._firsts: dict[int, A] = {}
        self._seconds: dict[int, B] = {}

    def add_first(self, stamp_ns: int, message: A) -> tuple[A, B] | None:
        """Take a message of the first topic; return the pair that it completes, if any."""
        if stamp_ns in self._seconds:
            return message, self._seconds.pop(stamp_ns)
        self._add(self._firsts, stamp_ns, message)
        return None

    def add_second(self, stamp_ns: int, message: B) -> tuple[A, B] | None:
        """Take a message of the second topic; return the pair that it completes, if any."""
        if stamp_ns in self._firsts:
            return self._firsts.pop(stamp_ns), message
        self._add(self._seconds, stamp_ns, message)
        return None

    def _add(self, waiting: dict[int, T], stamp_ns: int, message: T) -> None:
        if waiting.pop(stamp_ns, None) is not None:
            self.discarded += 1
        waiting[stamp_ns] = message
        if len(waiting) > self._depth:
            # A dict keeps the order of insertion, so its first key has waited longest.
            del waiting[next(iter(waiting))]
            self.discarded += 1
