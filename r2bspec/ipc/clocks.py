"""From the system clock to the monotonic one, on which all times of a run are.

The middleware stamps arrivals on the system clock. That clock can be set at any time, by hand or by
the network; the monotonic one cannot. Here the difference of the two is looked at each time a
message is taken, so that a step of the system clock is seen, and moves no time of a run.
"""

from __future__ import annotations

import time
from collections.abc import Callable

_MAX_READ_NS = 20_000
_MAX_READS = 5
"""The two clocks are read one after the other, and again if something came between."""

_MIN_STEP_NS = 2_000_000
_MAX_SLEW = 0.1
"""What is no step: the jitter of reading, and a clock that is being slewed, by at most a tenth."""


class ClockOffsetTracker:
    """The difference of the two clocks, followed through steps.

    Attributes:
        total_step_ns: by how much the system clock has been set forward since the start, in all.
        steps: how often it has been set.
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
        self._last_read_ns, self._difference_ns = self._read()
        self._difference_before_ns = self._difference_ns
        self._no_step_until_ns = self._last_read_ns

    def update(self) -> int:
        """Look whether the system clock has been set; returns the time, monotonic, in ns."""
        now_ns, difference_ns = self._read()
        moved_ns = difference_ns - self._difference_ns
        if abs(moved_ns) > _MIN_STEP_NS + _MAX_SLEW * (now_ns - self._last_read_ns):
            self.steps += 1
            self.total_step_ns += moved_ns
            self._difference_before_ns = self._difference_ns
            self._no_step_until_ns = self._last_read_ns
        self._last_read_ns, self._difference_ns = now_ns, difference_ns
        return now_ns

    def arrival(self, arrived_system_ns: int) -> tuple[int, int]:
        """When a message that is taken now arrived, and what time it is; both monotonic, in ns.

        A message that arrived before the clock was set, and is taken after, is told by what
        cannot be: that it arrived in the future, or before the last look that saw no step.

        Args:
            arrived_system_ns: the time of arrival by the system clock as it was then.
        """
        taken_ns = self.update()
        arrived_ns = arrived_system_ns - self._difference_ns
        if not self._no_step_until_ns <= arrived_ns <= taken_ns:
            arrived_ns = arrived_system_ns - self._difference_before_ns
        return min(arrived_ns, taken_ns), taken_ns

    def _read(self) -> tuple[int, int]:
        """The monotonic time, and by how much the system clock is ahead of it."""
        closest_ns, found = -1, (0, 0)
        for _ in range(_MAX_READS):
            before_ns = self._monotonic_ns()
            system_ns = self._system_ns()
            took_ns = self._monotonic_ns() - before_ns
            if closest_ns < 0 or took_ns < closest_ns:
                closest_ns = took_ns
                found = before_ns + took_ns, system_ns - before_ns - took_ns // 2
            if closest_ns <= _MAX_READ_NS:
                break
        return found
