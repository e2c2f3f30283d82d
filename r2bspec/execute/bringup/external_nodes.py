"""Nodes that the run does not start: they must already be there."""

from __future__ import annotations

from r2bspec.execute.bringup.start_deadline import StartDeadline
from r2bspec.execute.errors import NotReadyError
from r2bspec.execute.processes.supervisor import ManagedProcess, ProcessSupervisor
from r2bspec.ipc import protocol
from r2bspec.plan.plan import Plan

_POLL_S = 0.05
_REPLY_TIMEOUT_S = 10.0


def wait_for_external(
    plan: Plan, supervisor: ProcessSupervisor, observer: ManagedProcess, deadline: StartDeadline
) -> None:
    """Wait until every external node of the graph is seen.

    Raises:
        NotReadyError: one is not, in the time that the plan allows.
    """
    wanted = {each.name for each in plan.external if each.phase == "measure"}
    while True:
        survey = supervisor.request(
            observer, protocol.Survey(), protocol.Surveyed, _REPLY_TIMEOUT_S
        )
        missing = sorted(wanted - set(survey.nodes))
        if not missing:
            return
        if deadline.over:
            raise NotReadyError(
                f"external: {', '.join(missing)} cannot be seen",
                hint="Start it before the run, in the same ROS domain.",
                code="R2B649",
            )
        supervisor.pump(_POLL_S)
