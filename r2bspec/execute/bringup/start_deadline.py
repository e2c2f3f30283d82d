"""The deadline of a start, `benchmark.start_timeout`: first process to first output."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager


class StartDeadline:
    """A deadline that begins at its construction and that all steps of a start share.

    Attributes:
        timeout_s: how long the whole start may take, in seconds.
    """

    def __init__(self, timeout_ns: int, clock: Callable[[], float] = time.monotonic) -> None:
        self.timeout_s = timeout_ns / 1e9
        self._clock = clock
        self._ends_at = clock() + self.timeout_s

    @property
    def left_s(self) -> float:
        """How many seconds are left; 0 once it is over."""
        return max(0.0, self._ends_at - self._clock())

    @property
    def over(self) -> bool:
        """Whether the start has taken too long."""
        return self._clock() > self._ends_at

    @contextmanager
    def paused(self) -> Iterator[None]:
        """Do not count this time: readiness probes and commands have their own timeouts."""
        began = self._clock()
        try:
            yield
        finally:
            self._ends_at += self._clock() - began
