"""What a host is: its machine, its software and the labels that its owner gave it."""

from __future__ import annotations

import platform
import socket
from collections.abc import Mapping
from typing import Any

import msgspec

from r2bspec._version import __version__
from r2bspec.check.this_machine import gpus, ros_distro
from r2bspec.fleet.host_messages import PROTOCOL
from r2bspec.plan.host_match import MachineFacts


class HostFacts(msgspec.Struct, frozen=True, kw_only=True):
    """A host, as it describes itself when it joins a fleet.

    Attributes:
        doctor: what `r2bspec doctor` warns of there, by the name of the check.
        allows: what specs may do there besides running what is installed: ``commands``,
            ``python``.
    """

    name: str
    arch: str = ""
    cpu: str = ""
    cores: int = 0
    memory_bytes: int = 0
    gpus: tuple[str, ...] = ()
    ros_distro: str = ""
    rmw: str = ""
    os: str = ""
    labels: dict[str, str] = {}
    r2bspec: str = ""
    python: str = ""
    protocol: int = PROTOCOL
    doctor: dict[str, str] = {}
    allows: tuple[str, ...] = ()

    @property
    def machine(self) -> MachineFacts:
        """What requirements of specs are compared with."""
        return MachineFacts(
            arch=self.arch,
            cores=self.cores,
            gpus=self.gpus,
            ros_distro=self.ros_distro,
            labels=self.labels,
        )


def describe_host(
    name: str, labels: Mapping[str, str], *, allows: tuple[str, ...] = (), doctor: bool = True
) -> HostFacts:
    """Describe this machine.

    Args:
        name: in the fleet; that of the machine if empty.
        labels: of its owner.
        allows: see `HostFacts`.
        doctor: whether to run the checks of `r2bspec doctor`, which take a moment.
    """
    from r2bspec.execute.host.machine import describe_machine, describe_versions

    machine = describe_machine()
    versions = describe_versions()
    return HostFacts(
        name=name or socket.gethostname(),
        arch=machine["architecture"],
        cpu=machine["cpu"],
        cores=machine["cores"],
        memory_bytes=machine["memory_bytes"],
        gpus=tuple(machine["gpus"]) or gpus(),
        ros_distro=ros_distro(),
        rmw=versions.get("rmw", ""),
        os=machine["os"],
        labels=dict(labels),
        r2bspec=__version__,
        python=platform.python_version(),
        doctor=_warnings() if doctor else {},
        allows=allows,
    )


def read_facts(values: Mapping[str, Any]) -> HostFacts:
    """The description that a host sent.

    Raises:
        msgspec.ValidationError: it is none.
    """
    return msgspec.convert(values, HostFacts)


def _warnings() -> dict[str, str]:
    from pathlib import Path

    from r2bspec.doctor.all_checks import examine
    from r2bspec.doctor.checkup import System

    checks = examine(System(runs=Path("runs")))
    return {each.name: each.found for each in checks if each.status != "ok"}
