"""How far a run is: what a user interface is told of it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Protocol


class SegmentProgress(Protocol):
    """The progress of a segment; each value is computed only when it is requested."""

    def sent(self) -> int:
        """How many steps have been published."""

    def received(self) -> int:
        """How many messages have been received: the minimum over all monitors."""

    def p99_ns(self) -> int | None:
        """The p99 of the latest latencies; None before the first message."""

    def cores(self) -> Mapping[str, float]:
        """The recent CPU use of each process, in cores."""


class Progress:
    """Receives progress; every method returns immediately and never raises. These discard it."""

    def phase(self, name: str, text: str) -> None:
        """A phase of the plan begins."""

    def step(self, done: int, total: int) -> None:
        """How much of a countable phase is done."""

    def segment(self, title: str, steps: int) -> None:
        """A segment of `steps` steps begins."""

    def playing(self, view: SegmentProgress) -> None:
        """The progress of the current segment; called four times a second."""

    def waiting(self, place: str, left: str) -> None:
        """The run waits for others on this host; called five times a second.

        Args:
            place: in the queue, and whom it waits for.
            left: how long that will take.
        """
        if place != self._place:
            self._place = place
            self.note(f"{place}: {left}")

    _place = ""

    def note(self, text: str) -> None:
        """A one-line message for the user."""
