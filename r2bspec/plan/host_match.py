"""Whether a machine is one that a spec requires: a pure function of both."""

from __future__ import annotations

import fnmatch
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field

from r2bspec.language.spec import Requires, Scalar


@dataclass(frozen=True, kw_only=True)
class MachineFacts:
    """What of a machine specs can require.

    Attributes:
        arch: as the kernel calls it, such as ``aarch64``.
        cores: CPUs that a process may use.
        gpus: their names.
        ros_distro: empty if none is installed.
        labels: given by the owner of the machine.
    """

    arch: str
    cores: int
    gpus: tuple[str, ...] = ()
    ros_distro: str = ""
    labels: Mapping[str, str] = field(default_factory=dict)


def unmet(requires: Requires | None, machine: MachineFacts) -> tuple[str, ...]:
    """What a machine lacks, each as a clause such as ``it has 2 cores, not 8``; none if it fits."""
    return tuple(_unmet(requires, machine)) if requires is not None else ()


def _unmet(requires: Requires, machine: MachineFacts) -> Iterator[str]:
    if requires.arch and requires.arch != machine.arch:
        yield f"its architecture is {machine.arch}, not {requires.arch}"
    if requires.cores > machine.cores:
        yield f"it has {_count(machine.cores, 'core')}, not {requires.cores}"
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


def _count(number: int, noun: str) -> str:
    return f"{number} {noun}" if number == 1 else f"{number} {noun}s"
