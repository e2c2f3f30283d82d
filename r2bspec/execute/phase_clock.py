"""The time of each phase of a run, and of what the controller waits for in it."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Iterator

from r2bspec.record.phase_times import PhaseTime, WaitTime

_FIRST_PHASE = "prepare"


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
