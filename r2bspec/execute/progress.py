"""What the controller tells whoever shows the run to a user."""

from __future__ import annotations

from typing import Protocol


class Progress(Protocol):
    """A listener; every method returns at once and never raises."""

    def phase(self, name: str, text: str) -> None:
        """A phase of the plan begins."""

    def step(self, done: int, total: int) -> None:
        """How much of a phase that can be counted is done."""

    def segment(self, title: str, steps: int) -> None:
        """A stretch of `steps` steps begins to be played."""

    def playing(self, sent: int, received: int) -> None:
        """How far the segment is: `received` is the least over all monitors."""

    def note(self, text: str) -> None:
        """Something worth a line."""


class Silent:
    """Shows nothing."""

    def phase(self, name: str, text: str) -> None:
        """Ignore."""

    def step(self, done: int, total: int) -> None:
        """Ignore."""

    def segment(self, title: str, steps: int) -> None:
        """Ignore."""

    def playing(self, sent: int, received: int) -> None:
        """Ignore."""

    def note(self, text: str) -> None:
        """Ignore."""
