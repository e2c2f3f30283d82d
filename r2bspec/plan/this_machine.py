"""The properties of a machine that specs can require, and those of this machine.

They are read without importing or starting anything.
"""

from __future__ import annotations

import contextlib
import fnmatch
import importlib.util
import os
import re
import sys
from collections.abc import Iterator, Mapping
from importlib.machinery import ModuleSpec, PathFinder
from pathlib import Path
from typing import Final

import msgspec

from r2bspec.diagnostics.quote import pluralize
from r2bspec.language.spec import Requires, Scalar
from r2bspec.safe_io.safe_file import names_if_any
from r2bspec.safe_io.shared_lookups import shared_lookup

LABELS_VARIABLE: Final = "R2BSPEC_LABELS"
"""The labels of this machine, as ``robot=carter,floor=2``."""

ROS_DISTROS: Final = ("humble", "iron", "jazzy", "kilted", "lyrical", "rolling")

_RCLPY: Final = re.compile(r"ros[-_.](\w+?)[-_.]rclpy-[^-]+\.(?:dist|egg)-info$", re.IGNORECASE)
"""The folder with the metadata of the wheel of a distribution: importing what reads it takes longer
than all of this module."""

AMENT_INDEX: Final = "share/ament_index/resource_index"
PACKAGE_INDEX: Final = f"{AMENT_INDEX}/packages"

SHARED_MEMORY: Final = "/dev/shm"  # noqa: S108 -- only its size is read

_NVIDIA: Final = Path("/proc/driver/nvidia/gpus")
_OTHER_GPUS: Final = {"/dev/nvhost-gpu": "NVIDIA Tegra", "/dev/kfd": "AMD"}


CAP_SYS_NICE: Final = 23


class MachineFacts(msgspec.Struct, frozen=True, kw_only=True):
    """The properties of a machine that specs can require.

    Attributes:
        arch: as the kernel calls it, such as ``aarch64``.
        cores: CPUs that a process may use.
        cpu_quota: the CPU time that control groups allow, in cores; None without a limit.
        gpus: their names.
        ros_distro: empty if none is installed.
        labels: given by the owner of the machine.
    """

    arch: str = ""
    cores: int = 0
    cpu_quota: float | None = None
    gpus: tuple[str, ...] = ()
    ros_distro: str = ""
    labels: dict[str, str] = {}


def has_capability(number: int) -> bool:
    """Return True if this process has a capability, for which limits do not count."""
    try:
        lines = Path("/proc/self/status").read_text(encoding="utf-8").splitlines()
    except OSError:
        return False
    effective = next((line.split()[1] for line in lines if line.startswith("CapEff:")), "0")
    return bool(int(effective, 16) >> number & 1)


def ament_prefixes() -> list[Path]:
    """Return the folders in which ROS packages are installed."""
    prefixes = os.environ.get("AMENT_PREFIX_PATH") or ""
    return [Path(prefix) for prefix in prefixes.split(":") if prefix]


@shared_lookup
def this_machine() -> MachineFacts:
    """Return architecture, CPUs, GPUs, ROS distribution and labels of this machine."""
    return MachineFacts(
        arch=os.uname().machine,
        cores=len(os.sched_getaffinity(0)),
        cpu_quota=cpu_quota(),
        gpus=gpus(),
        ros_distro=ros_distro(),
        labels=labels_of(os.environ.get(LABELS_VARIABLE) or ""),
    )


def control_groups(proc: Path, sys: Path) -> Iterator[Path]:
    """Yield the group that limits the CPU time of this process, and the groups that contain it.

    In a container, paths may begin at a root outside of it; the mounted group is then the group
    of the container.
    """
    with contextlib.suppress(OSError):
        for line in (proc / "self/cgroup").read_text().splitlines():
            _, controllers, group = line.split(":", 2)
            # In version 2, a group has no controllers here.
            if not controllers or "cpu" in controllers.split(","):
                mount = sys / "fs/cgroup" / controllers
                if not mount.is_dir():
                    mount = sys / "fs/cgroup/cpu"
                path = mount / group.lstrip("/")
                for folder in (path, *path.parents):
                    if folder.is_relative_to(mount) and folder.is_dir():
                        yield folder


def cpu_quota(proc: Path = Path("/proc"), sys: Path = Path("/sys")) -> float | None:
    """Return the CPU time, in cores, that control groups of either version allow; None for all.

    Groups nest: the lowest limit counts.
    """
    limits = []
    for group in control_groups(proc, sys):
        text = _text(group / "cpu.max")
        text = text or f"{_text(group / 'cpu.cfs_quota_us')} {_text(group / 'cpu.cfs_period_us')}"
        quota, _, period = text.strip().partition(" ")
        # Without a limit, the quota is "max", or -1 in version 1.
        if quota.isdigit() and period.isdigit() and int(period):
            limits.append(int(quota) / int(period))
    return min(limits, default=None)


def _text(path: Path) -> str:
    try:
        return path.read_text(encoding="utf-8").strip()
    except OSError:
        return ""


def gpus() -> tuple[str, ...]:
    """Return the models of the GPUs for which the kernel has a driver."""
    try:
        folders = sorted(_NVIDIA.iterdir())
        return tuple(_model(folder) for folder in folders)
    except OSError:
        return tuple(name for file, name in _OTHER_GPUS.items() if Path(file).exists())


def shared_memory_bytes() -> int | None:
    """Return the size of the file system for shared memory; None if there is none."""
    try:
        file_system = os.statvfs(SHARED_MEMORY)
    except OSError:
        return None
    return file_system.f_blocks * file_system.f_frsize


def ros_distro() -> str:
    """Return the ROS distribution: a sourced one, or that of the wheels; empty without ROS."""
    return os.environ.get("ROS_DISTRO") or distro_of_wheels()


def distro_of_wheels() -> str:
    """Return the ROS distribution whose wheels are installed here; empty without wheels."""
    names = (name for folder in sys.path for name in names_if_any(Path(folder or ".")))
    installed = {match[1] for match in map(_RCLPY.match, names) if match}
    return next((distro for distro in ROS_DISTROS if distro in installed), "")


@shared_lookup
def find_module(name: str) -> ModuleSpec | None:
    """Find a module by its dotted name, without importing its parent packages."""
    top, *below = name.split(".")
    try:
        module = PathFinder.find_spec(top, _unseen_folders()) or importlib.util.find_spec(top)
    except (ImportError, ValueError):
        module = None
    path = top
    for part in below:
        if module is None or module.submodule_search_locations is None:
            return None
        path = f"{path}.{part}"
        module = PathFinder.find_spec(path, list(module.submodule_search_locations))
    return module


def module_file(name: str) -> Path | None:
    """Return the Python file of a module; None if it is not found, or has none."""
    module = find_module(name)
    origin = module.origin if module is not None else None
    return Path(origin) if origin is not None and origin.endswith(".py") else None


def _unseen_folders() -> list[str]:
    """Return the folders of PYTHONPATH if this interpreter ignores it (``-I``)."""
    if not sys.flags.ignore_environment:
        return []
    entries = (os.environ.get("PYTHONPATH") or "").split(os.pathsep)
    return [str(Path(entry).absolute()) for entry in entries if entry]


def labels_of(text: str) -> dict[str, str]:
    """Return labels from ``NAME=VALUE,NAME=VALUE``; parts without an equals sign are left out."""
    parts = (part.strip().partition("=") for part in text.split(","))
    return {name: value for name, equals, value in parts if equals and name}


def _model(folder: Path) -> str:
    for line in (folder / "information").read_text(errors="replace").splitlines():
        if line.startswith("Model:"):
            return line.partition(":")[2].strip()
    return "NVIDIA"


def unmet(requires: Requires | None, machine: MachineFacts) -> tuple[str, ...]:
    """Return the requirements that a machine misses, as clauses: ``it has 2 cores, not 8``.

    None if it fits.
    """
    return tuple(_unmet(requires, machine)) if requires is not None else ()


def _unmet(requires: Requires, machine: MachineFacts) -> Iterator[str]:
    if requires.arch and requires.arch != machine.arch:
        yield f"its architecture is {machine.arch}, not {requires.arch}"
    if requires.cores > machine.cores:
        yield f"it has {pluralize(machine.cores, 'core')}, not {requires.cores}"
    elif machine.cpu_quota is not None and requires.cores > machine.cpu_quota:
        yield (
            f"a control group allows the CPU time of {machine.cpu_quota:g} cores, not of "
            f"{requires.cores}"
        )
    if requires.ros_distro and requires.ros_distro != machine.ros_distro:
        have = f"it has ROS {machine.ros_distro}" if machine.ros_distro else "it has no ROS"
        yield f"{have}, not {requires.ros_distro}"
    if requires.gpu and not machine.gpus:
        yield "it has no GPU that is known"
    for name, value in requires.labels.items():
        yield from _unmet_label(name, value, machine.labels)


def _unmet_label(name: str, value: Scalar, labels: Mapping[str, str]) -> Iterator[str]:
    text = str(value).lower() if isinstance(value, bool) else str(value)
    if name not in labels:
        yield f"it has no label {name}"
    elif not fnmatch.fnmatchcase(labels[name], text):
        yield f"its label {name} is {labels[name]}, not {text}"
