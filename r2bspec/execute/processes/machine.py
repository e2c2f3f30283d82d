"""The machine of a run: its hardware and software, and reasons why it cannot run a plan.

A run is refused on a machine that its spec does not accept. If the disk of the run folder is full,
nodes fail in unrelated ways, and the error has to name the disk instead.
"""

from __future__ import annotations

import contextlib
import errno
import importlib.metadata
import os
import platform
import re
import tempfile
from pathlib import Path
from typing import Any

import psutil

from r2bspec._version import __version__
from r2bspec.execute.errors import CertainRunError
from r2bspec.execute.processes.devices import describe_devices
from r2bspec.middleware.middleware import middleware_of, selected_rmw
from r2bspec.plan.plan import Plan
from r2bspec.plan.this_machine import LABELS_VARIABLE, cpu_quota, this_machine, unmet
from r2bspec.safe_io.file_search import regular_files

_NEEDED_BYTES = 64 << 10
"""What a disk that is not full has room for; a node prints less at once."""

_FULL = frozenset({errno.ENOSPC, errno.EDQUOT})


def describe_machine() -> dict[str, Any]:
    """Return processor, memory, kernel and load of this machine, as far as they are known."""
    load_1min, load_5min, _ = os.getloadavg()
    frequency = None
    # Some platforms, and containers without /sys, do not provide the frequency.
    with contextlib.suppress(OSError, NotImplementedError):
        if current := psutil.cpu_freq():
            frequency = round(current.max or current.current)
    return {
        "architecture": platform.machine(),
        "cpu": _cpu_model(),
        "cores": len(os.sched_getaffinity(0)),
        "cpu_quota": cpu_quota(),
        "threads_per_core": _threads_per_core(),
        "cpu_max_mhz": frequency,
        "memory_bytes": psutil.virtual_memory().total,
        "kernel": platform.release(),
        "os": _os_name(),
        "load_1min": load_1min,
        "load_5min": load_5min,
        "cpu_governor": _read("/sys/devices/system/cpu/cpu0/cpufreq/scaling_governor"),
        **describe_devices(),
    }


def describe_versions() -> dict[str, str]:
    """Return the versions of r2bspec, Python, and the installed ROS packages."""
    versions = {"r2bspec": __version__, "python": platform.python_version()}
    middleware = middleware_of(os.environ).distributions
    for name in ("rclpy", *middleware, "numpy", "opencv-python-headless"):
        for candidate in (f"ros-jazzy-{name}", f"ros-{name}", name):
            try:
                versions[name] = importlib.metadata.version(candidate)
                break
            except importlib.metadata.PackageNotFoundError:
                continue
    if distribution := os.environ.get("ROS_DISTRO"):
        versions["ros_distro"] = distribution
    versions["rmw"] = selected_rmw(os.environ)
    return versions


def _cpu_model() -> str:
    match = re.search(r"^model name\s*: *(.*)", _read("/proc/cpuinfo"), re.MULTILINE)
    return match[1].strip() if match else platform.processor()


def _threads_per_core() -> int | None:
    """Return how many hardware threads share a core, at most.

    None where the kernel does not say.
    """
    siblings = [
        int(mask.replace(",", ""), 16).bit_count()
        for path in Path("/sys/devices/system/cpu").glob("cpu[0-9]*/topology/thread_siblings")
        if (mask := _read(path))
    ]
    return max(siblings, default=None)


def _os_name() -> str:
    try:
        return platform.freedesktop_os_release().get("PRETTY_NAME", platform.system())
    except OSError:
        return platform.system()


def _read(path: str | Path) -> str:
    try:
        return Path(path).read_text(errors="replace").strip()
    except OSError:
        return ""


def check_machine(plan: Plan) -> None:
    """Check that this machine is what a plan requires.

    Raises:
        CertainRunError: it is not (R2B677).
    """
    if plan.requires and (lacks := unmet(plan.requires, this_machine())):
        raise CertainRunError(
            f"this machine is not what the spec requires: {'; '.join(lacks)}",
            hint=f"Run it on a host that fits, for example with --on. {LABELS_VARIABLE} has the "
            "labels of this machine.",
            code="R2B677",
        )


def unwritable_log(folder: Path) -> Path | None:
    """Return the largest log of a run, if its disk has no room for more; else None.

    A node that cannot write its log may raise, exit or fall silent.
    """
    try:
        with tempfile.TemporaryFile(dir=folder) as file:
            os.posix_fallocate(file.fileno(), 0, _NEEDED_BYTES)
    except OSError as error:
        if error.errno in _FULL:
            logs = regular_files(folder / "logs")
            return max(logs, key=lambda each: each.lstat().st_size, default=None)
    return None
