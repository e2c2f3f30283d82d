"""How far a run is: what a user interface is told of it, and how long each phase has taken."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Iterator, Mapping
from typing import Protocol

from r2bspec.record.phase_times import PhaseTime, WaitTime

_FIRST_PHASE = "prepare"


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


class Progress(Protocol):
    """Receives progress; every method returns immediately and never raises."""

    def phase(self, name: str, text: str) -> None:
        """A phase of the plan begins."""

    def step(self, done: int, total: int) -> None:
        """How much of a countable phase is done."""

    def segment(self, title: str, steps: int) -> None:
        """A segment of `steps` steps begins."""

    def playing(self, view: SegmentProgress) -> None:
        """The progress of the current segment; called four times a second."""

    def note(self, text: str) -> None:
        """A one-line message for the user."""


class NullProgress:
    """Discards all progress."""

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


class PhaseClock:
    """Divides the time since it was made into phases."""

    def __init__(self) -> None:
        self._ended: list[PhaseTime] = []
        self._waits: dict[str, tuple[int, int]] = {}
        self._is_waiting = False
        self._start(_FIRST_PHASE)

    def begin(self, name: str) -> None:
        """End the phase that runs, and begin another one."""
        self._ended = [*self.phases()]
        self._start(name)

    def _start(self, name: str) -> None:
        self._name = name
        self._began_ns, self._began_cpu_ns = time.monotonic_ns(), time.process_time_ns()
        self._waits = {}

    @contextlib.contextmanager
    def waiting(self, what: str) -> Iterator[None]:
        """Count the time of the block as a wait; one inside another belongs to the outer one."""
        if self._is_waiting:
            yield
            return
        began_ns, self._is_waiting = time.monotonic_ns(), True
        # A phase that begins meanwhile has no part in this wait.
        waits = self._waits
        try:
            yield
        finally:
            self._is_waiting = False
            count, took_ns = waits.get(what, (0, 0))
            waits[what] = count + 1, took_ns + time.monotonic_ns() - began_ns

    def phases(self) -> tuple[PhaseTime, ...]:
        """All phases; the last one, which runs, as if it ended now."""
        waits = [
            WaitTime(what=what, count=count, took_ns=took_ns)
            for what, (count, took_ns) in self._waits.items()
        ]
        running = PhaseTime(
            name=self._name,
            began_ns=self._began_ns,
            ended_ns=time.monotonic_ns(),
            cpu_ns=time.process_time_ns() - self._began_cpu_ns,
            waits=tuple(sorted(waits, key=lambda each: each.took_ns, reverse=True)),
        )
        return (*self._ended, running)
