"""What specs can require of this machine, read without any library."""

from __future__ import annotations

import os
import platform
import sys
from pathlib import Path
from typing import Final

from r2bspec.plan.host_match import MachineFacts
from r2bspec.untrusted.looked_up_files import environment_variable, note_lookup, shared_lookup

LABELS_VARIABLE: Final = "R2BSPEC_LABELS"
"""The labels of this machine, as ``robot=carter,floor=2``."""

ROS_DISTROS: Final = ("humble", "iron", "jazzy", "kilted", "lyrical", "rolling")

ARCHITECTURES: Final = (
    *("aarch64", "armv7l", "i686", "loongarch64", "ppc64le", "riscv64", "s390x", "x86_64"),
)
"""As the kernel calls them."""

_NVIDIA: Final = Path("/proc/driver/nvidia/gpus")
_OTHER_GPUS: Final = {"/dev/nvhost-gpu": "NVIDIA Tegra", "/dev/kfd": "AMD"}


@shared_lookup
def this_machine() -> MachineFacts:
    """Architecture, CPUs, GPUs, ROS distribution and labels of this machine."""
    return MachineFacts(
        arch=platform.machine(),
        cores=len(os.sched_getaffinity(0)),
        gpus=gpus(),
        ros_distro=ros_distro(),
        labels=labels_of(environment_variable(LABELS_VARIABLE) or ""),
    )


def gpus() -> tuple[str, ...]:
    """The GPUs of which the kernel has a driver, by their models."""
    try:
        found = sorted(_NVIDIA.iterdir())
        return tuple(_model(each) for each in found)
    except OSError:
        return tuple(name for file, name in _OTHER_GPUS.items() if Path(file).exists())


def ros_distro() -> str:
    """The ROS distribution: a sourced one, or that of the wheels; empty if there is none."""
    if distribution := environment_variable("ROS_DISTRO"):
        return distribution
    from importlib.metadata import PackageNotFoundError, version

    for each in sys.path:
        note_lookup(Path(each))
    for distro in ROS_DISTROS:
        try:
            version(f"ros-{distro}-rclpy")
        except PackageNotFoundError:
            continue
        return distro
    return ""


def labels_of(text: str) -> dict[str, str]:
    """Labels from ``NAME=VALUE,NAME=VALUE``; parts without an equals sign are left out."""
    parts = (each.strip().partition("=") for each in text.split(","))
    return {name: value for name, equals, value in parts if equals and name}


def _model(folder: Path) -> str:
    for line in (folder / "information").read_text(errors="replace").splitlines():
        if line.startswith("Model:"):
            return line.partition(":")[2].strip()
    return "NVIDIA"
