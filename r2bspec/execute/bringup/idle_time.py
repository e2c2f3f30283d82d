"""For how long processes have done nothing."""

from __future__ import annotations

import contextlib
import math
import time
from collections.abc import Callable, Iterable, Iterator
from typing import Final

import psutil

from r2bspec.execute.host.process_counters import RunQueueWaits

_BUSY_SHARE: Final = 0.1
"""Of one processor: a node whose timers or discovery threads only look around takes less."""

_MIN_WINDOW_S: Final = 0.5


class IdleTime:
    """Measures for how long some processes have neither run nor waited for a processor.

    Args:
        pids: says which processes these are now.
        clock: a monotonic clock in seconds.
    """

    def __init__(
        self, pids: Callable[[], Iterable[int]], clock: Callable[[], float] = time.monotonic
    ) -> None:
        self._pids = pids
        self._clock = clock
        self._waits = RunQueueWaits()
        self._busy_s = self._total_busy_s()
        self._idle_since = self._looked_at = clock()

    def update(self) -> float:
        """Look at the processes; returns for how many seconds they have been idle."""
        now = self._clock()
        passed_s = now - self._looked_at
        if passed_s < _MIN_WINDOW_S:
            return self._looked_at - self._idle_since
        before_s, self._busy_s = self._busy_s, self._total_busy_s()
        if abs(self._busy_s - before_s) > _BUSY_SHARE * passed_s:
            self._idle_since = now
        self._looked_at = now
        return now - self._idle_since

    def _total_busy_s(self) -> float:
        """How long the processes have run, or waited for a processor, in seconds."""
        pids = [*self._pids()]
        total_s = 0.0
        for pid in pids:
            with contextlib.suppress(psutil.Error):
                used = psutil.Process(pid).cpu_times()
                total_s += used.user + used.system
        waited_s = self._waits.update(0, pids)
        return total_s if math.isnan(waited_s) else total_s + waited_s


def family(pid: int) -> Iterator[int]:
    """A process, and all that descend from it."""
    yield pid
    with contextlib.suppress(psutil.Error):
        yield from (each.pid for each in psutil.Process(pid).children(True))
