"""Requirements of a machine that no machine can meet."""

from __future__ import annotations

from typing import Final

from r2bspec.check.rule_api import Context, Finding, Findings, Rule
from r2bspec.check.this_machine import ARCHITECTURES, ROS_DISTROS
from r2bspec.diagnostics import did_you_mean

_OTHER_NAMES: Final = {"arm64": "aarch64", "amd64": "x86_64", "x64": "x86_64", "x86-64": "x86_64"}


def _find(context: Context) -> Findings:
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


RULE = Rule(code="R2B669", find=_find)
