"""What the controller tells whoever shows the run to a user."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Protocol


class SegmentProgress(Protocol):
    """A stretch while it is being played; what is not asked for costs nothing."""

    def sent(self) -> int:
        """How many steps have been published."""

    def received(self) -> int:
        """How many messages have come: the least over all monitors."""

    def p99_ns(self) -> int | None:
        """The p99 of the latest latencies; None before the first message."""

    def cores(self) -> Mapping[str, float]:
        """Processor time per time of each process lately; 1 is one core."""


class Progress(Protocol):
    """A listener; every method returns at once and never raises."""

    def phase(self, name: str, text: str) -> None:
        """A phase of the plan begins."""

    def step(self, done: int, total: int) -> None:
        """How much of a phase that can be counted is done."""

    def segment(self, title: str, steps: int) -> None:
        """A stretch of `steps` steps begins to be played."""

    def playing(self, view: SegmentProgress) -> None:
        """How far the segment is; told four times a second."""

    def note(self, text: str) -> None:
        """Something worth a line."""


class NullProgress:
    """Shows nothing."""

    def phase(self, name: str, text: str) -> None:
        """Ignore."""

    def step(self, done: int, total: int) -> None:
        """Ignore."""

    def segment(self, title: str, steps: int) -> None:
        """Ignore."""

    def playing(self, view: SegmentProgress) -> None:
        """Ignore."""

    def note(self, text: str) -> None:
        """Ignore."""
