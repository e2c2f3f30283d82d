"""What specs can require of this machine, read without any library."""

from __future__ import annotations

import os
import re
import sys
from pathlib import Path
from typing import Final

from r2bspec.plan.host_match import MachineFacts
from r2bspec.untrusted.looked_up_files import shared_lookup
from r2bspec.untrusted.safe_file import names_in

LABELS_VARIABLE: Final = "R2BSPEC_LABELS"
"""The labels of this machine, as ``robot=carter,floor=2``."""

ROS_DISTROS: Final = ("humble", "iron", "jazzy", "kilted", "lyrical", "rolling")

ARCHITECTURES: Final = (
    *("aarch64", "armv7l", "i686", "loongarch64", "ppc64le", "riscv64", "s390x", "x86_64"),
)
"""As the kernel calls them."""

_RCLPY: Final = re.compile(r"ros[-_.](\w+?)[-_.]rclpy-[^-]+\.(?:dist|egg)-info$", re.IGNORECASE)
"""The folder with the metadata of the wheel of a distribution: importing what reads it takes longer
than all of this module."""

SHARED_MEMORY: Final = "/dev/shm"  # noqa: S108 -- only its size is read

_NVIDIA: Final = Path("/proc/driver/nvidia/gpus")
_OTHER_GPUS: Final = {"/dev/nvhost-gpu": "NVIDIA Tegra", "/dev/kfd": "AMD"}


@shared_lookup
def this_machine() -> MachineFacts:
    """Architecture, CPUs, GPUs, ROS distribution and labels of this machine."""
    return MachineFacts(
        arch=os.uname().machine,
        cores=len(os.sched_getaffinity(0)),
        gpus=gpus(),
        ros_distro=ros_distro(),
        labels=labels_of(os.environ.get(LABELS_VARIABLE) or ""),
    )


def gpus() -> tuple[str, ...]:
    """The GPUs of which the kernel has a driver, by their models."""
    try:
        folders = sorted(_NVIDIA.iterdir())
        return tuple(_model(folder) for folder in folders)
    except OSError:
        return tuple(name for file, name in _OTHER_GPUS.items() if Path(file).exists())


def shared_memory_bytes() -> int | None:
    """The size of the file system for shared memory; None where there is none."""
    try:
        file_system = os.statvfs(SHARED_MEMORY)
    except OSError:
        return None
    return file_system.f_blocks * file_system.f_frsize


def ros_distro() -> str:
    """The ROS distribution: a sourced one, or that of the wheels; empty if there is none."""
    if distribution := os.environ.get("ROS_DISTRO"):
        return distribution
    installed = {
        match[1] for folder in sys.path for match in map(_RCLPY.match, _names_in(folder)) if match
    }
    return next((distro for distro in ROS_DISTROS if distro in installed), "")


def _names_in(folder: str) -> list[str]:
    try:
        return names_in(Path(folder or "."))
    except OSError:
        return []


def labels_of(text: str) -> dict[str, str]:
    """Labels from ``NAME=VALUE,NAME=VALUE``; parts without an equals sign are left out."""
    parts = (part.strip().partition("=") for part in text.split(","))
    return {name: value for name, equals, value in parts if equals and name}


def _model(folder: Path) -> str:
    for line in (folder / "information").read_text(errors="replace").splitlines():
        if line.startswith("Model:"):
            return line.partition(":")[2].strip()
    return "NVIDIA"
