"""How long processes were runnable but had no processor: the run-queue wait of their threads.

The kernel counts it for every thread, in the second field of ``/proc/PID/task/TID/schedstat``, in
nanoseconds. It is the time that other programs, or other threads of the run, took from them.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from pathlib import Path
from typing import Final

_PROC: Final = Path("/proc")


class RunQueueWaits:
    """The cumulative waits of groups of processes. Threads that have ended stay counted."""

    def __init__(self, proc: Path = _PROC) -> None:
        """See whether the kernel counts waits.

        Args:
            proc: where the process file system is.
        """
        self._proc = proc
        self._is_known = (proc / "self" / "schedstat").exists()
        self._last_ns: dict[tuple[int, int], int] = {}
        self._total_ns: dict[int, int] = {}

    def update(self, index: int, pids: Iterable[int]) -> float:
        """The wait of all threads of a group so far, in seconds; NaN if the kernel counts none.

        Args:
            index: of the group.
            pids: its processes that run now.
        """
        if not self._is_known:
            return math.nan
        grown_ns = sum(self._grown_ns(pid) for pid in pids)
        self._total_ns[index] = self._total_ns.get(index, 0) + grown_ns
        return self._total_ns[index] / 1e9

    def _grown_ns(self, pid: int) -> int:
        tasks = self._proc / str(pid) / "task"
        grown_ns = 0
        try:
            threads = [*tasks.iterdir()]
        except OSError:
            return 0
        for thread in threads:
            try:
                now_ns = int((thread / "schedstat").read_bytes().split()[1])
            except (OSError, ValueError, IndexError):
                continue
            key = (pid, int(thread.name))
            before_ns = self._last_ns.get(key, 0)
            # The number of a thread that has ended may be used again.
            grown_ns += now_ns - before_ns if now_ns >= before_ns else now_ns
            self._last_ns[key] = now_ns
        return grown_ns
