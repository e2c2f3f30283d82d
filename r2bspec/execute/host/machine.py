"""The machine of a run, and the versions of its software."""

from __future__ import annotations

import importlib.metadata
import os
import platform
import sys
from pathlib import Path
from typing import Any

import psutil

from r2bspec._version import __version__
from r2bspec.middleware.middleware import middleware_of, selected_rmw


def describe_machine() -> dict[str, Any]:
    """Processor, memory, kernel and load of this machine, as far as they are known."""
    load_1min, load_5min, _ = os.getloadavg()
    frequency = None
    # Some platforms, and containers without /sys, do not provide the frequency.
    try:
        current = psutil.cpu_freq()
        frequency = round(current.max or current.current) if current else None
    except (OSError, NotImplementedError):
        frequency = None
    return {
        "architecture": platform.machine(),
        "cpu": _cpu_model(),
        "cores": len(os.sched_getaffinity(0)),
        "cpu_max_mhz": frequency,
        "memory_bytes": psutil.virtual_memory().total,
        "kernel": platform.release(),
        "os": _os_name(),
        "load_1min": load_1min,
        "load_5min": load_5min,
        "cpu_governor": _read("/sys/devices/system/cpu/cpu0/cpufreq/scaling_governor"),
        "gpus": _gpus(),
    }


def describe_versions() -> dict[str, str]:
    """Versions of r2bspec, Python, and the ROS packages that are installed."""
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


def interpreter() -> str:
    """The interpreter that replaces ``$(python)``."""
    return sys.executable


def _cpu_model() -> str:
    for line in _read("/proc/cpuinfo").splitlines():
        if line.startswith("model name"):
            return line.partition(":")[2].strip()
    return platform.processor()


def _gpus() -> list[str]:
    """The names of the NVIDIA GPUs, if NVML and its bindings (the extra `gpu`) are installed."""
    try:
        import pynvml

        pynvml.nvmlInit()
    except Exception:  # the bindings raise their own errors where there is no driver
        return []
    try:
        count = pynvml.nvmlDeviceGetCount()
        return [
            str(pynvml.nvmlDeviceGetName(pynvml.nvmlDeviceGetHandleByIndex(n)))
            for n in range(count)
        ]
    finally:
        pynvml.nvmlShutdown()


def _os_name() -> str:
    try:
        return platform.freedesktop_os_release().get("PRETTY_NAME", platform.system())
    except OSError:
        return platform.system()


def _read(path: str) -> str:
    try:
        return Path(path).read_text(errors="replace").strip()
    except OSError:
        return ""
