"""Requirements of a machine that this one does not meet."""

from __future__ import annotations

import msgspec

from r2bspec.check.rule_api import Context, Finding, Findings, Rule
from r2bspec.check.this_machine import ARCHITECTURES, ROS_DISTROS, this_machine
from r2bspec.language.spec import Requires
from r2bspec.plan.host_match import unmet


def _find(context: Context) -> Findings:
    if lacks := unmet(_known(context.spec.requires), this_machine()):
        yield Finding(
            message=f"this machine is not what the spec requires: {'; '.join(lacks)}",
            path=("requires",),
            help="run it on a host that fits, for example with 'run --on'; R2BSPEC_LABELS has the "
            "labels of this machine",
            machine_dependent=True,
        )


def _known(requires: Requires | None) -> Requires | None:
    """Without what no machine is: that is a finding of its own."""
    if requires is None:
        return None
    return msgspec.structs.replace(
        requires,
        arch=requires.arch if requires.arch in ARCHITECTURES else "",
        ros_distro=requires.ros_distro if requires.ros_distro in ROS_DISTROS else "",
    )


RULE = Rule(code="R2B676", find=_find)
