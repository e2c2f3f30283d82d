"""A run is refused on a machine that its spec does not accept."""

from __future__ import annotations

from r2bspec.check.this_machine import LABELS_VARIABLE, this_machine
from r2bspec.execute.errors import OtherMachineError
from r2bspec.plan.host_match import unmet
from r2bspec.plan.plan import Plan


def check_machine(plan: Plan) -> None:
    """See that this machine is what a plan requires.

    Raises:
        OtherMachineError: it is not.
    """
    if plan.requires and (lacks := unmet(plan.requires, this_machine())):
        raise OtherMachineError(
            f"this machine is not what the spec requires: {'; '.join(lacks)}",
            hint=f"Run it on a host that fits, for example with --on. {LABELS_VARIABLE} has the "
            "labels of this machine.",
        )
