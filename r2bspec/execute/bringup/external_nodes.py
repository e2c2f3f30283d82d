"""Nodes that the run does not start: they must already be there."""

from __future__ import annotations

from r2bspec.execute.bringup.start_deadline import StartDeadline
from r2bspec.execute.errors import NotReadyError
from r2bspec.execute.processes.supervisor import Child, Children
from r2bspec.ipc import protocol
from r2bspec.plan.plan import Plan

_POLL_S = 0.05
_ASK_S = 10.0


def wait_for_external(
    plan: Plan, children: Children, observer: Child, deadline: StartDeadline
) -> None:
    """Wait until every external node of the graph is seen.

    Raises:
        NotReadyError: one is not, in the time that the plan allows.
    """
    wanted = {each.name for each in plan.external if each.phase == "measure"}
    while True:
        survey = children.ask(observer, protocol.Survey(), protocol.Surveyed, _ASK_S)
        missing = sorted(wanted - set(survey.nodes))
        if not missing:
            return
        if deadline.over:
            raise NotReadyError(
                f"external: {', '.join(missing)} cannot be seen",
                hint="Start it before the run, in the same ROS domain.",
                code="R2B649",
            )
        children.pump(_POLL_S)
