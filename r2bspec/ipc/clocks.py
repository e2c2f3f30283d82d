"""Noticing that the system clock is set during a run.

This clock can be set at any time, manually or over the network; the monotonic clock, which all
times of a run use, cannot. What a step means for arrivals is in `r2bspec.ipc.arrivals`.
"""

from __future__ import annotations

import time
from collections.abc import Callable

_MAX_READ_NS = 20_000
_MAX_READS = 5
"""The clocks are read one after the other, and again if the reads were interrupted."""

_MIN_STEP_NS = 2_000_000
_MAX_SLEW = 0.1
"""Smaller changes are not steps: the jitter of reading, and slewing of the clock by up to 10 %."""


class ClockOffsetTracker:
    """Tracks the offset of the two clocks, and its steps.

    Attributes:
        total_step_ns: the sum of the steps of the system clock since the start.
        steps: their number.
    """

    def __init__(
        self,
        monotonic_ns: Callable[[], int] = time.monotonic_ns,
        system_ns: Callable[[], int] = time.time_ns,
    ) -> None:
        self._monotonic_ns = monotonic_ns
        self._system_ns = system_ns
        self.total_step_ns = 0
        self.steps = 0
        self._last_read_ns, self._difference_ns = read_clocks(monotonic_ns, system_ns)

    def update(self) -> int:
        """Check whether the system clock was set; returns the monotonic time in ns."""
        now_ns, difference_ns = read_clocks(self._monotonic_ns, self._system_ns)
        moved_ns = difference_ns - self._difference_ns
        if abs(moved_ns) > _MIN_STEP_NS + _MAX_SLEW * (now_ns - self._last_read_ns):
            self.steps += 1
            self.total_step_ns += moved_ns
        self._last_read_ns, self._difference_ns = now_ns, difference_ns
        return now_ns


def read_clocks(
    monotonic_ns: Callable[[], int] = time.monotonic_ns, system_ns: Callable[[], int] = time.time_ns
) -> tuple[int, int]:
    """The monotonic time, and the system time minus the monotonic time, in ns."""
    closest_ns, found = -1, (0, 0)
    for _ in range(_MAX_READS):
        before_ns = monotonic_ns()
        there_ns = system_ns()
        took_ns = monotonic_ns() - before_ns
        if closest_ns < 0 or took_ns < closest_ns:
            closest_ns = took_ns
            found = before_ns + took_ns, there_ns - before_ns - took_ns // 2
        if closest_ns <= _MAX_READ_NS:
            break
    return found
