"""This machine, and the machine that a spec requires: CPUs, architecture, environment."""

from __future__ import annotations

import os
from collections.abc import Iterator
from typing import Final

import msgspec

from r2bspec.check.check_context import Context
from r2bspec.check.rule import Finding, Findings, rule
from r2bspec.diagnostics import did_you_mean
from r2bspec.diagnostics.diagnostic import Path
from r2bspec.language.spec import Requires
from r2bspec.plan.this_machine import ARCHITECTURES, ROS_DISTROS, this_machine, unmet


@rule("R2B617")
def environment_variable_unset(context: Context) -> Findings:
    """Listed environment variables that are not set."""
    for index, name in enumerate(context.spec.environment):
        if os.environ.get(name) is None:
            yield Finding(
                message=f"environment variable {name} is not set",
                path=("environment", index),
                help=f"set it, for example: export {name}=...",
                machine_dependent=True,
            )


@rule("R2B638")
def cpus_not_available(context: Context) -> Findings:
    """CPUs that this machine does not have."""
    available = os.cpu_count() or 1
    for path, cpus in _pinned_cpus(context):
        for index, cpu in enumerate(cpus):
            if cpu >= available:
                yield Finding(
                    message=f"this machine has no CPU {cpu}",
                    path=(*path, index),
                    help=f"its CPUs are numbered from 0 to {available - 1}",
                    machine_dependent=True,
                )


def _pinned_cpus(context: Context) -> Iterator[tuple[Path, tuple[int, ...]]]:
    for name, container in context.spec.containers.items():
        yield ("containers", name, "cpus"), container.cpus
    for _, node in context.nodes:
        yield (*node.path, "cpus"), node.node.cpus


_OTHER_NAMES: Final = {"arm64": "aarch64", "amd64": "x86_64", "x64": "x86_64", "x86-64": "x86_64"}


@rule("R2B669")
def required_machine_unknown(context: Context) -> Findings:
    """Requirements of a machine that no machine can meet."""
    requires = context.spec.requires
    if requires is None:
        return
    if requires.arch and requires.arch not in ARCHITECTURES:
        close = _OTHER_NAMES.get(requires.arch.lower()) or did_you_mean(
            requires.arch, ARCHITECTURES
        )
        yield Finding(
            message=f"no machine has the architecture {requires.arch!r}",
            path=("requires", "arch"),
            help=f"write {close!r}" if close else f"known: {', '.join(ARCHITECTURES)}",
        )
    if requires.ros_distro and requires.ros_distro not in ROS_DISTROS:
        close = did_you_mean(requires.ros_distro, ROS_DISTROS)
        yield Finding(
            message=f"there is no ROS distribution {requires.ros_distro!r}",
            path=("requires", "ros_distro"),
            help=f"did you mean {close!r}?" if close else f"known: {', '.join(ROS_DISTROS)}",
        )


@rule("R2B675")
def pinned_cpu_beyond_required(context: Context) -> Findings:
    """CPUs that a machine with the required number of cores may not have."""
    requires = context.spec.requires
    if requires is None or not requires.cores:
        return
    for path, cpus in _pinned_cpus(context):
        if cpus and max(cpus) >= requires.cores:
            yield Finding(
                message=f"CPU {max(cpus)} is pinned, but a machine with "
                f"{requires.cores} cores is accepted",
                path=path,
                help=f"set 'requires.cores' to {max(cpus) + 1}: CPUs are numbered from 0",
            )


@rule("R2B676")
def machine_not_as_required(context: Context) -> Findings:
    """Requirements of a machine that this one does not meet."""
    if lacks := unmet(_meetable(context.spec.requires), this_machine()):
        yield Finding(
            message=f"this machine is not what the spec requires: {'; '.join(lacks)}",
            path=("requires",),
            help="run it on a host that fits, for example with 'run --on'; R2BSPEC_LABELS has the "
            "labels of this machine",
            machine_dependent=True,
        )


def _meetable(requires: Requires | None) -> Requires | None:
    """Without what no machine is: that is a finding of its own."""
    if requires is None:
        return None
    return msgspec.structs.replace(
        requires,
        arch=requires.arch if requires.arch in ARCHITECTURES else "",
        ros_distro=requires.ros_distro if requires.ros_distro in ROS_DISTROS else "",
    )
