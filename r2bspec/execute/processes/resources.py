"""CPU and memory of every process over the whole run, sampled on a thread of the controller.

Host interference and devices are sampled at the same times. In addition to its periodic samples,
the sampler takes samples on request: at the start and end of every segment, so that the use in a
segment need not be interpolated.

Host interference: counters for the load of other processes. All values are cumulative, so the
difference of two readings is the interference between them. A value that the system does not
provide is NaN, never zero.

A process belongs to the session that the run has opened for it. What opens a session of its own is
found by its parent; if that has ended, it still has the id of the run in its environment, which
every process inherits and which is read once for each process of the machine.

How long a process was runnable but had no processor is counted for every thread, in the second
field of ``/proc/PID/task/TID/schedstat``, in nanoseconds: it is the time that other programs, or
other threads of the run, took from it.
"""

from __future__ import annotations

import contextlib
import heapq
import itertools
import math
import os
import re
import struct
import threading
import time
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np
import psutil

from r2bspec.execute.processes.devices import DeviceReader
from r2bspec.ipc.process_cleanup import carries_run_id
from r2bspec.judge.measure.host_usage import CONTROLLER_INDEX, MACHINE_INDEX, ORPHANS_INDEX
from r2bspec.plan.this_machine import control_groups
from r2bspec.record.sample_arrays import DEVICE_DTYPE, INTERFERENCE_DTYPE, RESOURCE_DTYPE, Rows

_SYSTEM = Path("/")

_PROC: Final = Path("/proc")

_Counters = tuple[tuple[str, float], ...]
"""Patterns of numbers in files of the kernel, each with what it is divided by."""

_PRESSURE: Final[_Counters] = ((r"^some .*total=(\d+)$", 1e6),)
_QUOTA: Final[_Counters] = ((r"^throttled_usec (\d+)$", 1e6), (r"^throttled_time (\d+)$", 1e9))
"""In version 2 of control groups, and in version 1."""

_THERMAL: Final[_Counters] = ((r"^(\d+)$", 1e3),)
_FREQUENCY: Final[_Counters] = ((r"^(\d+)$", 1e-3),)
"""In kHz, so that the value is in Hz."""


class InterferenceReading(NamedTuple):
    """A reading of host interference; see `r2bspec.record.sample_arrays.INTERFERENCE_FIELDS`."""

    busy_s: float
    stolen_s: float
    waited_s: float
    throttled_s: float
    cycles: float


class InterferenceReader:
    """Reads the counters of the control group of this process, on the cores that it may use."""

    def __init__(self, root: Path = _SYSTEM) -> None:
        """Find the available counters.

        Args:
            root: where ``/proc`` and ``/sys`` are.
        """
        self._cores = sorted(os.sched_getaffinity(0))
        groups = [*control_groups(root / "proc", root / "sys")]
        self._pressure = next(
            (path for path in (group / "cpu.pressure" for group in groups) if path.exists()),
            root / "proc/pressure/cpu",
        )
        self._quota_files = [
            path for path in (group / "cpu.stat" for group in groups) if path.exists()
        ]
        self._thermal_files = [
            *root.glob("sys/devices/system/cpu/cpu*/thermal_throttle/core_throttle_total_time_ms")
        ]
        self._frequency = str(root / "sys/devices/system/cpu/cpu{}/cpufreq/scaling_cur_freq")
        self._cycles = 0.0
        self._used_s: dict[int, float] = {}

    def read(self) -> InterferenceReading:
        """Return the current values of the counters."""
        times = dict(zip(_cores_online(), psutil.cpu_times(percpu=True), strict=False))
        ours = {core: times[core] for core in self._cores if core in times}
        used_s = {core: busy_seconds(of_core) for core, of_core in ours.items()}
        self._count_cycles(used_s)
        quota = _largest(_QUOTA, self._quota_files)
        heat = _largest(_THERMAL, self._thermal_files)
        throttled_s = [seconds for seconds in (quota, heat) if not math.isnan(seconds)]
        return InterferenceReading(
            busy_s=sum(used_s.values()),
            stolen_s=sum(getattr(core, "steal", math.nan) for core in ours.values()),
            waited_s=_counted(_PRESSURE, self._pressure),
            throttled_s=sum(throttled_s) if throttled_s else quota,
            cycles=self._cycles,
        )

    def _count_cycles(self, used_s: dict[int, float]) -> None:
        """Add those of the cores that were in use since the last reading; no other core is read."""
        for core, now_s in used_s.items():
            grown_s = now_s - self._used_s.get(core, 0.0)
            if grown_s > 0 and not math.isnan(self._cycles):
                self._cycles += grown_s * _counted(_FREQUENCY, Path(self._frequency.format(core)))
        self._used_s = used_s


def _cores_online() -> list[int]:
    """Return the numbers of the cores that are online, in the order of psutil."""
    with Path(psutil.PROCFS_PATH, "stat").open() as file:
        lines = itertools.takewhile(lambda line: line.startswith("cpu"), file)
        return [int(line.split(maxsplit=1)[0][3:]) for line in lines if line[3].isdigit()]


def busy_seconds(times: psutil._ntuples.scputimes) -> float:
    """Return the CPU time in use: neither idle, nor taken by other virtual machines."""
    used = sum(times) - times.idle - getattr(times, "iowait", 0.0) - getattr(times, "steal", 0.0)
    # Guest time is contained in user time already.
    return float(used - getattr(times, "guest", 0.0) - getattr(times, "guest_nice", 0.0))


def _counted(counters: _Counters, path: Path) -> float:
    """Return the first of some numbers that a file has; NaN without one."""
    with contextlib.suppress(OSError, ValueError):
        text = path.read_text()
        for pattern, divisor in counters:
            if match := re.search(pattern, text, re.MULTILINE):
                return int(match[1]) / divisor
    return math.nan


def _largest(counters: _Counters, paths: list[Path]) -> float:
    """Return the largest value; a sum would count nested groups and cores twice."""
    values = (_counted(counters, path) for path in paths)
    return max((value for value in values if not math.isnan(value)), default=math.nan)


class Members:
    """The processes of a run: each belongs to the process of the plan that it descends from.

    A process belongs to the process that leads its session, or else to that of its parent. One that
    only has the id of the run in its environment belongs to no process that is known.
    """

    def __init__(self, run_id: str) -> None:
        """Remember the run; with an empty id, no environment is read."""
        self._run_id = run_id
        self._owners: dict[int, int | None] = {}

    def find(self, leaders: Mapping[int, int], unknown: int) -> dict[int, list[int]]:
        """Return the running processes of each process of the plan.

        Args:
            leaders: process id to index, of all processes that the controller has started; each is
                the leader of a session.
            unknown: the index for processes of which only the run is known.
        """
        running = sorted({*psutil.pids()} - {os.getpid()})
        owners: dict[int, int | None] = {}
        for pid in running:
            if pid in leaders:
                owners[pid] = leaders[pid]
            elif pid in self._owners:
                owners[pid] = self._owners[pid]
            # The controller may be about to add a child of its own.
            elif (parent := _parent_of(pid)) != os.getpid():
                owner = leaders.get(_session_of(pid), owners.get(parent))
                is_of_run = owner is None and carries_run_id(pid, self._run_id)
                owners[pid] = unknown if is_of_run else owner
        self._owners = owners
        members: dict[int, list[int]] = {}
        for pid, owner in owners.items():
            if owner is not None:
                members.setdefault(owner, []).append(pid)
        return members


def _parent_of(pid: int) -> int:
    try:
        return psutil.Process(pid).ppid()
    except psutil.Error:
        return -1


def _session_of(pid: int) -> int:
    try:
        return os.getsid(pid)
    except OSError:
        return -1


class RunQueueWaits:
    """The cumulative waits of groups of processes. Threads that have ended stay counted."""

    def __init__(self, proc: Path = _PROC) -> None:
        """Check whether the kernel counts waits.

        Args:
            proc: where the process file system is.
        """
        self._proc = proc
        self._is_known = (proc / "self" / "schedstat").exists()
        self._last_ns: dict[tuple[int, int], int] = {}
        self._total_ns: dict[int, int] = {}

    def update(self, index: int, pids: Iterable[int]) -> float:
        """Return the wait of all threads of a group so far, in seconds.

        NaN if the kernel counts none.

        Args:
            index: the index of the group.
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


def family(pid: int) -> list[int]:
    """Return a process and all its descendants."""
    with contextlib.suppress(psutil.Error):
        return [pid, *(child.pid for child in psutil.Process(pid).children(recursive=True))]
    return [pid]


_PERIOD_S = 0.2
"""Samples are cumulative, so a longer period affects only maxima. A sample of three processes of 13
threads each takes about a millisecond of CPU time, 0.6 % of a core at this period."""

_RESOURCES = struct.Struct("<qidqd")
_INTERFERENCE = struct.Struct("<qddddd")
"""Rows of `r2bspec.record.sample_arrays.RESOURCE_FIELDS` and `INTERFERENCE_FIELDS`."""


class ResourceSampler:
    """Samples CPU time, memory and host interference until stopped.

    Processes are numbered in the order in which they are added, the same as in
    `RunRecord.processes`.
    """

    def __init__(self, run_id: str = "") -> None:
        """Prepare for the processes of a run.

        Args:
            run_id: the identifier of the run; without it, orphaned processes are not found.
        """
        self._leaders: dict[int, int] = {}
        self._members = Members(run_id)
        self._uses: dict[int, _Use] = {}
        self._orphans = _Use()
        self._waits = RunQueueWaits()
        # Packed in the format of the file: a day of samples takes some ten megabytes.
        self._rows = bytearray()
        self._interference_rows = bytearray()
        self._interference = InterferenceReader()
        self._device_rows = bytearray()
        self._devices = DeviceReader()
        self._self = psutil.Process()
        self._requested_ns: list[int] = []
        self._lock = threading.Condition()
        self._stopped = False
        self._thread = threading.Thread(target=self._run, name="resources", daemon=True)

    def start(self) -> None:
        """Start sampling."""
        self._thread.start()

    def add(self, pid: int) -> None:
        """Sample one more process, with its descendants."""
        with self._lock:
            self._leaders[pid] = len(self._uses)
            self._uses[len(self._uses)] = _Use()

    def sample_at(self, time_ns: int) -> None:
        """Schedule a sample at a time (CLOCK_MONOTONIC); a past time means immediately."""
        with self._lock:
            heapq.heappush(self._requested_ns, time_ns)
            self._lock.notify()

    def resident(self, pid: int) -> int:
        """Return the last sampled resident memory of a process and its descendants, in bytes."""
        return self._uses[self._leaders[pid]].resident if pid in self._leaders else 0

    def stop(self) -> tuple[Rows, Rows]:
        """Stop sampling, and return `rows` and `interference`."""
        with self._lock:
            self._stopped = True
            self._lock.notify()
        if self._thread.is_alive():
            self._thread.join()
        self._sample()
        return self.rows(), self.interference()

    def rows(self) -> Rows:
        """Return the samples so far: rows of `r2bspec.record.sample_arrays.RESOURCE_DTYPE`."""
        return np.frombuffer(bytes(self._rows), dtype=RESOURCE_DTYPE)

    def interference(self) -> Rows:
        """Return the samples of host interference: rows of `sample_arrays.INTERFERENCE_DTYPE`."""
        return np.frombuffer(bytes(self._interference_rows), dtype=INTERFERENCE_DTYPE)

    def devices(self) -> Rows:
        """Return the samples of devices: rows of `sample_arrays.DEVICE_DTYPE`."""
        return np.frombuffer(bytes(self._device_rows), dtype=DEVICE_DTYPE)

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
            leaders, uses = dict(self._leaders), {**self._uses, ORPHANS_INDEX: self._orphans}
        self._interference_rows += _INTERFERENCE.pack(
            time.monotonic_ns(), *self._interference.read()
        )
        memory = psutil.virtual_memory()
        ours = self._self.cpu_times()
        for index, used_s, used_bytes in (
            (MACHINE_INDEX, busy_seconds(psutil.cpu_times()), memory.total - memory.available),
            (CONTROLLER_INDEX, ours.user + ours.system, self._self.memory_info().rss),
        ):
            self._rows += _RESOURCES.pack(time.monotonic_ns(), index, used_s, used_bytes, math.nan)
        members = self._members.find(leaders, ORPHANS_INDEX)
        owners = {pid: index for index, pids in members.items() for pid in pids}
        self._device_rows += b"".join(self._devices.rows(owners))
        for index, use in uses.items():
            now_ns, pids = time.monotonic_ns(), members.get(index, [])
            use.read(pids)
            if pids:
                waited_s = self._waits.update(index, pids)
                self._rows += _RESOURCES.pack(now_ns, index, use.cpu_s, use.resident, waited_s)


class _Use:
    """What a process has used, with its descendants.

    The time of a process that has ended is in the ``children_*`` fields of its parent, if that has
    waited for it; else what was last read of it stays counted.

    Attributes:
        cpu_s: CPU time in seconds; it never falls.
        resident: of all that run now, in bytes.
    """

    def __init__(self) -> None:
        self.cpu_s = 0.0
        self.resident = 0
        self._running: dict[int, tuple[float, int]] = {}
        self._ended_s = 0.0

    def read(self, pids: Iterable[int]) -> None:
        """Read the processes that run now; one that ends meanwhile is left out."""
        before, self._running = self._running, {}
        self.resident = 0
        for pid in pids:
            with contextlib.suppress(psutil.Error):
                process = psutil.Process(pid)
                with process.oneshot():
                    times, parent = process.cpu_times(), process.ppid()
                    own_s = times.user + times.system
                    used_s = own_s + times.children_user + times.children_system
                    self.resident += process.memory_info().rss
                self._running[pid] = used_s, parent
        self._ended_s += sum(
            used_s
            for pid, (used_s, parent) in before.items()
            if pid not in self._running and parent not in self._running
        )
        running_s = sum(used_s for used_s, _ in self._running.values())
        self.cpu_s = max(self.cpu_s, running_s + self._ended_s)
