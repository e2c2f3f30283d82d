"""What the kernel says of the machine and of the processes of a run.

Host interference: counters for the load of other processes. All values are cumulative, so the
difference of two readings is the interference between them. A value that the system does not
provide is NaN, never zero.

Descendants of a process are found by their parents. Processes whose parents have ended, daemons and
what a launcher leaves behind, are in no tree: they carry the id of the run in their environment,
which every process inherits and which is read once for each process of the machine.

How long a process was runnable but had no processor is counted for every thread, in the second
field of ``/proc/PID/task/TID/schedstat``, in nanoseconds: it is the time that other programs, or
other threads of the run, took from it.
"""

from __future__ import annotations

import contextlib
import math
import os
from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path
from typing import Final, NamedTuple

import psutil

from r2bspec.ipc.protocol import RUN_ID_VARIABLE

_SYSTEM = Path("/")

_AFTER_NAME = 2
"""The number of the first field after the name, which may itself have blanks and brackets."""

_MINOR, _MINOR_OF_CHILDREN = 9, 10
"""The places of ``minflt`` and ``cminflt`` in /proc/PID/stat, counted from 0 (see proc(5))."""

_PROC: Final = Path("/proc")


class InterferenceReading(NamedTuple):
    """One reading; see `r2bspec.record.run_record.INTERFERENCE_FIELDS`."""

    busy_s: float
    stolen_s: float
    waited_s: float
    throttled_s: float


class InterferenceReader:
    """Reads the counters of the control group of this process, on the cores that it may use."""

    def __init__(self, root: Path = _SYSTEM) -> None:
        """Find the available counters.

        Args:
            root: where ``/proc`` and ``/sys`` are.
        """
        self._cores = sorted(os.sched_getaffinity(0))
        groups = [*_control_groups(root)]
        self._pressure = next(
            (each for each in (group / "cpu.pressure" for group in groups) if each.exists()),
            root / "proc/pressure/cpu",
        )
        self._quota_files = [
            each for each in (group / "cpu.stat" for group in groups) if each.exists()
        ]
        self._thermal_files = [
            *root.glob("sys/devices/system/cpu/cpu*/thermal_throttle/core_throttle_total_time_ms")
        ]

    def read(self) -> InterferenceReading:
        """The current values of the counters."""
        busy_s, stolen_s = _core_times(self._cores)
        quota = _largest(_throttled_s, self._quota_files)
        heat = _largest(_thermal_throttled_s, self._thermal_files)
        known = [each for each in (quota, heat) if not math.isnan(each)]
        return InterferenceReading(
            busy_s, stolen_s, _cpu_pressure_s(self._pressure), sum(known) if known else quota
        )


def _core_times(cores: list[int]) -> tuple[float, float]:
    times = psutil.cpu_times(percpu=True)
    # A core that was taken offline has no line.
    ours = [times[core] for core in cores if core < len(times)]
    return (
        sum(busy_seconds(each) for each in ours),
        sum(getattr(each, "steal", math.nan) for each in ours),
    )


def busy_seconds(times: psutil._ntuples.scputimes) -> float:
    """CPU time in use: neither idle, nor taken by other virtual machines."""
    used = sum(times) - times.idle - getattr(times, "iowait", 0.0) - getattr(times, "steal", 0.0)
    # Guest time is contained in user time already.
    return float(used - getattr(times, "guest", 0.0) - getattr(times, "guest_nice", 0.0))


def _cpu_pressure_s(path: Path) -> float:
    """``some avg10=0.00 avg60=0.00 avg300=0.00 total=MICROSECONDS``."""
    with contextlib.suppress(OSError, ValueError):
        for line in path.read_text().splitlines():
            if line.startswith("some "):
                return int(line.rpartition("total=")[2]) / 1e6
    return math.nan


def _throttled_s(path: Path) -> float:
    """``throttled_usec`` in version 2 of control groups, ``throttled_time`` (ns) in version 1."""
    with contextlib.suppress(OSError, ValueError):
        for line in path.read_text().splitlines():
            name, _, value = line.partition(" ")
            if name == "throttled_usec":
                return int(value) / 1e6
            if name == "throttled_time":
                return int(value) / 1e9
    return math.nan


def _thermal_throttled_s(path: Path) -> float:
    with contextlib.suppress(OSError, ValueError):
        return int(path.read_text()) / 1e3
    return math.nan


def _largest(read: Callable[[Path], float], paths: list[Path]) -> float:
    """The largest value: groups nest, and cores are throttled together, so sums would be wrong."""
    return max((found for each in paths if not math.isnan(found := read(each))), default=math.nan)


def _control_groups(root: Path) -> Iterator[Path]:
    """The group that limits the CPU time of this process, and the groups that contain it.

    In a container, paths may begin at a root outside of it; the mounted group is then the group
    of the container.
    """
    with contextlib.suppress(OSError):
        for line in (root / "proc/self/cgroup").read_text().splitlines():
            _, controllers, group = line.split(":", 2)
            for mount in _mounts(root, controllers):
                path = mount / group.lstrip("/")
                yield from (each for each in (path, *path.parents) if _within(each, mount))


def _mounts(root: Path, controllers: str) -> list[Path]:
    base = root / "sys/fs/cgroup"
    if not controllers:
        return [base]
    return [base / controllers] if "cpu" in controllers.split(",") else []


def _within(path: Path, mount: Path) -> bool:
    return path.is_relative_to(mount) and path.is_dir()


def minor_faults(pid: int) -> int:
    """The page faults that needed no disk, with those of children that have exited; 0 if unknown.

    Memory that was mapped freshly causes one for each page that is touched first, such as the
    pages of a large message whose buffer the allocator gave back before.
    """
    try:
        fields = Path(f"/proc/{pid}/stat").read_bytes().rpartition(b")")[2].split()
        return sum(int(fields[each - _AFTER_NAME]) for each in (_MINOR, _MINOR_OF_CHILDREN))
    except (OSError, IndexError, ValueError):
        return 0


class OrphanFinder:
    """Finds them; each is attributed to the process of the run that it descends from."""

    def __init__(self, run_id: str, proc: Path = _PROC) -> None:
        """Nothing is read yet.

        Args:
            run_id: of the run; if it is empty, nothing is ever found.
            proc: where the process file system is.
        """
        self._proc = proc
        self._wanted = f"{RUN_ID_VARIABLE}={run_id}".encode() if run_id else b""
        self._belongs: dict[int, bool] = {}
        self._owners: dict[int, int] = {}

    def find(
        self, descendants: Mapping[int, int], leaders: Mapping[int, int], unknown: int
    ) -> dict[int, int]:
        """The orphans that run now: process id to the index of the process it belongs to.

        Args:
            descendants: process id to index, of all processes of the run that have a parent in it,
                and of those that the controller started.
            leaders: process id to index, of all processes that the controller has ever started;
                each is the leader of a session.
            unknown: the index for orphans of which only the run is known.
        """
        if not self._wanted:
            return {}
        running = set(psutil.pids())
        # Numbers are used again.
        self._belongs = {pid: ours for pid, ours in self._belongs.items() if pid in running}
        self._owners = {pid: index for pid, index in self._owners.items() if pid in running}
        self._owners |= descendants
        for pid in running - self._belongs.keys():
            self._belongs[pid] = pid in descendants or self._has_run_id(pid)
        found: dict[int, int] = {}
        for pid, ours in self._belongs.items():
            if ours and pid not in descendants and pid not in leaders and pid != os.getpid():
                if pid not in self._owners:
                    self._owners[pid] = leaders.get(_session_of(pid), unknown)
                found[pid] = self._owners[pid]
        return found

    def _has_run_id(self, pid: int) -> bool:
        try:
            variables = (self._proc / str(pid) / "environ").read_bytes()
        except OSError:
            return False
        return self._wanted in variables.split(b"\0")


def _session_of(pid: int) -> int:
    try:
        return os.getsid(pid)
    except OSError:
        return -1


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


def family(pid: int) -> list[int]:
    """A process and all that descend from it, those that were started after their parents."""
    with contextlib.suppress(psutil.Error):
        return [pid, *(child.pid for child in psutil.Process(pid).children(recursive=True))]
    return [pid]
