"""External nodes: the run does not start them; they must already run."""

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
    """Wait until discovery shows every external node of the graph.

    Raises:
        NotReadyError: a node is missing at the deadline.
    """
    wanted = {each.name for each in plan.external if each.phase == "measure"}
    while True:
        survey = supervisor.request(
            observer, protocol.ListGraph(), protocol.GraphSnapshot, _REPLY_TIMEOUT_S
        )
        missing = sorted(wanted - set(survey.nodes))
        if not missing:
            return
        if deadline.over:
            raise NotReadyError(
                f"external: {', '.join(missing)} is not running, or not in this ROS domain",
                hint="Start it before the run, in the same ROS domain.",
                code="R2B649",
            )
        supervisor.pump(_POLL_S)
