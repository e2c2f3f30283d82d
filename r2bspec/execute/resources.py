"""CPU and memory of every process over the whole run, sampled on a thread of the controller."""

from __future__ import annotations

import contextlib
import threading
import time
from typing import TYPE_CHECKING

import psutil

if TYPE_CHECKING:
    from r2bspec.record.arrays import Rows

_PERIOD_S = 0.2
"""Samples are cumulative, so a longer period blurs only maxima; at 0.2 s the sampling of ten
processes costs about a thousandth of a core."""

SYSTEM = -1


class ResourceSampler:
    """Samples processor time and memory until stopped.

    Processes are numbered in the order in which they are added, the same as in
    `RunRecord.processes`.
    """

    def __init__(self) -> None:
        self._processes: list[psutil.Process | None] = []
        self._rows: list[tuple[int, int, float, int]] = []
        self._resident: dict[int, int] = {}
        self._lock = threading.Lock()
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name="resources", daemon=True)

    def start(self) -> None:
        """Begin to sample."""
        self._thread.start()

    def add(self, pid: int) -> None:
        """Sample one more process, with its descendants."""
        process = None
        with contextlib.suppress(psutil.Error):
            process = psutil.Process(pid)
        with self._lock:
            self._processes.append(process)

    def resident(self, pid: int) -> int:
        """The resident memory of a process and its descendants when last sampled, in bytes."""
        return self._resident.get(pid, 0)

    def stop(self) -> Rows:
        """End sampling; returns rows of `r2bspec.record.arrays.RESOURCES` in order of time."""
        self._stop.set()
        if self._thread.is_alive():
            self._thread.join()
        self._sample()
        return self.rows()

    def rows(self) -> Rows:
        """What has been sampled so far: rows as `stop` returns them."""
        import numpy as np

        from r2bspec.record.arrays import RESOURCES

        return np.array(list(self._rows), dtype=RESOURCES)

    def _run(self) -> None:
        while not self._stop.is_set():
            self._sample()
            self._stop.wait(_PERIOD_S)

    def _sample(self) -> None:
        with self._lock:
            processes = list(enumerate(self._processes))
        busy = psutil.cpu_times()
        busy_s = sum(busy) - busy.idle - getattr(busy, "iowait", 0.0)
        # Guest time is contained in user time already.
        busy_s -= getattr(busy, "guest", 0.0) + getattr(busy, "guest_nice", 0.0)
        memory = psutil.virtual_memory()
        self._rows.append((time.monotonic_ns(), SYSTEM, busy_s, memory.total - memory.available))
        for number, process in processes:
            if process is None:
                continue
            try:
                now_ns = time.monotonic_ns()
                cpu_s, resident = _with_descendants(process)
            except psutil.Error:
                with self._lock:
                    self._processes[number] = None
                continue
            self._resident[process.pid] = resident
            self._rows.append((now_ns, number, cpu_s, resident))


def _with_descendants(process: psutil.Process) -> tuple[float, int]:
    """Processor time in seconds and resident bytes of a process and all its living descendants.

    The time of descendants that have ended is in the `children_*` fields of their parents.
    """
    cpu_s, resident = 0.0, 0
    for each in (process, *process.children(recursive=True)):
        try:
            with each.oneshot():
                times = each.cpu_times()
                cpu_s += times.user + times.system + times.children_user + times.children_system
                resident += each.memory_info().rss
        except psutil.NoSuchProcess:
            if each is process:
                raise
    return cpu_s, resident
