"""CPU and memory of every process over the whole run, sampled on a thread of the controller.

Host interference is sampled at the same times. In addition to its periodic samples, the sampler
takes samples on request: at the start and end of every segment, so that the use in a segment need
not be interpolated.
"""

from __future__ import annotations

import contextlib
import heapq
import struct
import threading
import time
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import psutil

from r2bspec.execute.host.interference_counters import InterferenceReader, busy_seconds
from r2bspec.execute.host.orphans import OrphanTracker
from r2bspec.measure.resource_usage import CONTROLLER_INDEX, MACHINE_INDEX, ORPHANS_INDEX

if TYPE_CHECKING:
    from r2bspec.record.sample_arrays import Rows

_PERIOD_S = 0.2
"""Samples are cumulative, so a longer period affects only maxima. A sample of three processes takes
about half a millisecond of CPU time, 0.3 % of a core at this period."""

_RESOURCES = struct.Struct("<qidq")
_INTERFERENCE = struct.Struct("<qdddd")
"""Rows of `r2bspec.record.run_record.RESOURCE_FIELDS` and `INTERFERENCE_FIELDS`."""


class ResourceSampler:
    """Samples CPU time, memory and host interference until stopped.

    Processes are numbered in the order in which they are added, the same as in
    `RunRecord.processes`.
    """

    def __init__(self, run_id: str = "") -> None:
        """Create a sampler; with a `run_id`, orphans of the run count, too."""
        self._orphans = OrphanTracker(run_id)
        self._processes: list[psutil.Process | None] = []
        # Packed in the format of the file: a day of samples takes some ten megabytes.
        self._rows = bytearray()
        self._interference_rows = bytearray()
        self._interference = InterferenceReader()
        self._self = psutil.Process()
        self._resident: dict[int, int] = {}
        self._cores: dict[int, float] = {}
        self._last_use: dict[int, tuple[int, float]] = {}
        self._requested_ns: list[int] = []
        self._lock = threading.Condition()
        self._stopped = False
        self._thread = threading.Thread(target=self._run, name="resources", daemon=True)

    def start(self) -> None:
        """Start sampling."""
        self._thread.start()

    def add(self, pid: int) -> None:
        """Sample one more process, with its descendants."""
        process = None
        with contextlib.suppress(psutil.Error):
            process = psutil.Process(pid)
        with self._lock:
            self._processes.append(process)

    def sample_at(self, time_ns: int) -> None:
        """Schedule a sample at a time (CLOCK_MONOTONIC); a past time means immediately."""
        with self._lock:
            heapq.heappush(self._requested_ns, time_ns)
            self._lock.notify()

    def resident(self, pid: int) -> int:
        """The last sampled resident memory of a process and its descendants, in bytes."""
        return self._resident.get(pid, 0)

    def cores(self, pid: int) -> float | None:
        """The CPU use, in cores, of a process and its descendants between the last two samples.

        None if it was not sampled twice yet, or has exited.
        """
        return self._cores.get(pid)

    def stop(self) -> tuple[Rows, Rows]:
        """Stop sampling; returns the results of `rows` and `interference`."""
        with self._lock:
            self._stopped = True
            self._lock.notify()
        if self._thread.is_alive():
            self._thread.join()
        self._sample()
        return self.rows(), self.interference()

    def rows(self) -> Rows:
        """The samples so far: rows of `r2bspec.record.sample_arrays.RESOURCE_DTYPE`."""
        import numpy as np

        from r2bspec.record.sample_arrays import RESOURCE_DTYPE

        return np.frombuffer(bytes(self._rows), dtype=RESOURCE_DTYPE)

    def interference(self) -> Rows:
        """The same of host interference: rows of `sample_arrays.INTERFERENCE_DTYPE`."""
        import numpy as np

        from r2bspec.record.sample_arrays import INTERFERENCE_DTYPE

        return np.frombuffer(bytes(self._interference_rows), dtype=INTERFERENCE_DTYPE)

    def _run(self) -> None:
        while True:
            self._sample()
            with self._lock:
                if self._wait_for_next():
                    return

    def _wait_for_next(self) -> bool:
        """Wait for the end of the period or a requested time; True if stopped."""
        end_ns = time.monotonic_ns() + round(_PERIOD_S * 1e9)
        while not self._stopped:
            next_ns = min([end_ns, *self._requested_ns[:1]])
            now_ns = time.monotonic_ns()
            if now_ns >= next_ns:
                while self._requested_ns and self._requested_ns[0] <= now_ns:
                    heapq.heappop(self._requested_ns)
                return False
            self._lock.wait((next_ns - now_ns) / 1e9)
        return True

    def _sample(self) -> None:
        with self._lock:
            processes = list(enumerate(self._processes))
        self._interference_rows += _INTERFERENCE.pack(
            time.monotonic_ns(), *self._interference.read()
        )
        busy_s = busy_seconds(psutil.cpu_times())
        memory = psutil.virtual_memory()
        self._append_row(
            MACHINE_INDEX, time.monotonic_ns(), busy_s, memory.total - memory.available
        )
        ours = self._self.cpu_times()
        resident = self._self.memory_info().rss
        self._append_row(CONTROLLER_INDEX, time.monotonic_ns(), ours.user + ours.system, resident)
        uses: dict[int, tuple[psutil.Process, int, float, int]] = {}
        families: dict[int, set[int]] = {}
        for number, process in processes:
            if process is None:
                continue
            try:
                now_ns = time.monotonic_ns()
                family = (process, *_descendants(process))
                uses[number] = (process, now_ns, *_use_of(family))
                families[number] = {each.pid for each in family}
            except psutil.Error:
                with self._lock:
                    self._processes[number] = None
                self._cores.pop(process.pid, None)
        roots = {process.pid: number for number, (process, *_) in uses.items()}
        orphans = self._orphans.use(families, roots, ORPHANS_INDEX)
        for number, (process, now_ns, own_s, own) in uses.items():
            more_s, more = orphans.get(number, (0.0, 0))
            self._resident[process.pid] = own + more
            self._update_cores(process.pid, now_ns, own_s + more_s)
            self._append_row(number, now_ns, own_s + more_s, own + more)
        if ORPHANS_INDEX in orphans:
            self._append_row(ORPHANS_INDEX, time.monotonic_ns(), *orphans[ORPHANS_INDEX])

    def _append_row(self, process: int, time_ns: int, cpu_s: float, memory_bytes: int) -> None:
        self._rows += _RESOURCES.pack(time_ns, process, cpu_s, memory_bytes)

    def _update_cores(self, pid: int, now_ns: int, cpu_s: float) -> None:
        before_ns, before_s = self._last_use.get(pid, (now_ns, cpu_s))
        # CPU time has a resolution of 10 ms, so shorter intervals have no meaning.
        if now_ns - before_ns >= _PERIOD_S * 1e9 / 2:
            self._cores[pid] = (cpu_s - before_s) / ((now_ns - before_ns) / 1e9)
        elif pid in self._last_use:
            return
        self._last_use[pid] = (now_ns, cpu_s)


def _descendants(process: psutil.Process) -> list[psutil.Process]:
    """All running descendants of a process.

    If the kernel was built with lists of the children of each thread, they are used; psutil reads
    the parent of every process of the machine instead, which takes most of the time of a sample.
    """
    found: list[psutil.Process] = []
    waiting = [process.pid]
    while waiting:
        tasks = Path(f"/proc/{waiting.pop()}/task")
        try:
            children = {
                int(child)
                for task in tasks.iterdir()
                for child in (task / "children").read_text().split()
            }
        except OSError:
            # The process or one of its threads has just exited, or the kernel has no such lists.
            return process.children(recursive=True)
        waiting += children
        for child in children:
            with contextlib.suppress(psutil.Error):
                found.append(psutil.Process(child))
    return found


def _use_of(family: Sequence[psutil.Process]) -> tuple[float, int]:
    """CPU time in seconds and resident bytes of a process, the first, and its descendants.

    The time of descendants that have exited is in the `children_*` fields of their parents.
    """
    cpu_s, resident = 0.0, 0
    for each in family:
        try:
            with each.oneshot():
                times = each.cpu_times()
                cpu_s += times.user + times.system + times.children_user + times.children_system
                resident += each.memory_info().rss
        except psutil.NoSuchProcess:
            if each is family[0]:
                raise
    return cpu_s, resident
