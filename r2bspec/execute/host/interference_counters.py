"""Host interference: counters of the kernel for the load of other processes during a run.

All values are cumulative, so the difference of two readings is the interference between them. A
value that the system does not provide is NaN, never zero.
"""

from __future__ import annotations

import contextlib
import math
import os
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import NamedTuple

import psutil

_SYSTEM = Path("/")


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
