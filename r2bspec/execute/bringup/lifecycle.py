"""Lifecycle nodes: brought into the states of the spec, or recognised if the spec has none.

The endpoints of such a node may exist only once it is configured, so its state is changed before
they are waited for. All nodes are configured, then activated, each time in the order of the spec. A
node whose state the spec does not mention is left alone: something in the graph, such as a
lifecycle manager, activates it. If nothing there can, the run ends with an error instead of
waiting.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable
from dataclasses import dataclass
from typing import Final, NamedTuple

from r2bspec.execute.bringup.readiness import StartDeadline
from r2bspec.execute.errors import GraphDifferencesError, NotReadyError, ProcessDiedError
from r2bspec.execute.processes.supervisor import REPLY_TIMEOUT_S, ProcessSupervisor
from r2bspec.ipc import protocol
from r2bspec.language.spec import LifecycleState
from r2bspec.plan.command_lines import has_planned_name
from r2bspec.plan.plan import HARNESS_PARTS, Plan, ProcessPlan
from r2bspec.record.run_record import Difference

TRANSITION_FAILED: Final = "R2B605"
NOT_ACTIVATED: Final = "R2B237"
_NO_LIFECYCLE_NODE: Final = "R2B238"

_STEPS: Final[dict[protocol.Transition, tuple[str, frozenset[LifecycleState]]]] = {
    "configure": ("unconfigured", frozenset({"inactive", "active"})),
    "activate": ("inactive", frozenset({"active"})),
}
"""Each transition: the state that it leads from, and the wanted states that need it."""

_PRIMARY_STATES: Final = frozenset({"unconfigured", "inactive", "active", "finalized"})
"""In every other state a callback runs."""

_ASK_NS = 2_000_000_000
_POLL_S = 0.1
_DISCOVERY_S = 4.0
"""How much later than its node a service may be discovered, on a busy machine."""


@dataclass(frozen=True)
class LifecycleNodes:
    """The lifecycle nodes of the graph of one phase; see `PhaseGraph`."""

    plan: Plan
    phase: str
    supervisor: ProcessSupervisor
    note: Callable[[str], None]

    def bring_up(
        self,
        deadline: StartDeadline,
        enter: Callable[[protocol.Transition], None] = lambda _: None,
    ) -> None:
        """Configure and activate the nodes whose states the plan has.

        Args:
            deadline: of the start.
            enter: is called before the first of all nodes makes a transition.

        Raises:
            GraphDifferencesError: a transition failed, or a node is no lifecycle node.
            NotReadyError: a node is not there in time, or does not answer.
        """
        wanted = self.plan.states_in(self.phase)
        if not wanted:
            return
        with self.supervisor.waiting("lifecycle nodes: discovery"):
            states = self._wait_for(wanted, deadline)
        for transition, (before, targets) in _STEPS.items():
            nodes = [
                name
                for name, target in wanted.items()
                if target in targets and states[name] == before
            ]
            if nodes:
                enter(transition)
            for name in nodes:
                states[name] = self._change(name, transition, deadline)
        for name, target in wanted.items():
            if states[name] == "finalized":
                message = f"{name} cannot be {target}: it is finalized"
                raise _mismatch(TRANSITION_FAILED, name, "", message, "read its output")
            if states[name] != target:
                self.note(f"{name} is {states[name]}, not {target}: it changes its state itself")

    def _wait_for(
        self, wanted: dict[str, LifecycleState], deadline: StartDeadline
    ) -> dict[str, str]:
        """Return the states of nodes, once all of them have been discovered.

        Raises:
            GraphDifferencesError: a node has no states.
            NotReadyError: a node is not there in time, or does not report its state.
        """
        seen_s: dict[str, float] = {}
        while True:
            found = self._ask_states()
            missing = [name for name in wanted if found.states.get(name) not in _PRIMARY_STATES]
            if not missing:
                return found.states
            graph = self.supervisor.ask_observer(protocol.ListGraph(), protocol.GraphSnapshot)
            for name in missing:
                if name not in graph.nodes or name in found.states:
                    continue
                since_s = seen_s.setdefault(name, deadline.left_s)
                if since_s - deadline.left_s > _DISCOVERY_S:
                    raise _mismatch(
                        _NO_LIFECYCLE_NODE,
                        name,
                        "",
                        f"{name} is no lifecycle node: it has no service change_state",
                        "remove 'lifecycle'",
                    )
            if deadline.over:
                name = missing[0]
                raise NotReadyError(
                    f"lifecycle node {name} does not report its state"
                    if name in found.states
                    else f"lifecycle node {name} did not appear within {deadline.timeout_s:g} s",
                    hint="Read its output, or increase benchmark.start_timeout.",
                )
            self.supervisor.pump(_POLL_S)

    def _ask_states(self) -> protocol.LifecycleStates:
        return self.supervisor.ask_observer(
            protocol.ListLifecycle(timeout_ns=_ASK_NS),
            protocol.LifecycleStates,
            _ASK_NS / 1e9 + REPLY_TIMEOUT_S,
        )

    def _change(self, name: str, transition: protocol.Transition, deadline: StartDeadline) -> str:
        """Let a node make a transition; returns the state that it is in then.

        Raises:
            GraphDifferencesError: its callback did not succeed.
            NotReadyError: it does not answer in time.
            ProcessDiedError: its process has ended.
        """
        own = next(
            process.name
            for process in self._processes()
            if any(node.name == name for node in process.nodes)
        )
        child = next(process for process in self.supervisor if process.name == own)
        timeout_s = deadline.left_s
        command = protocol.ChangeState(
            node=name, transition=transition, timeout_ns=round(timeout_s * 1e9)
        )
        try:
            with self.supervisor.waiting(f"{name}: {transition}"):
                changed = self.supervisor.ask_observer(
                    command, protocol.StateChanged, timeout_s + REPLY_TIMEOUT_S
                )
        except ProcessDiedError as died:
            raise died.while_doing(f"{name} could not {transition}", name) from died
        # A node may activate itself meanwhile, and refuse what it has done already.
        if changed.result == "success" or changed.state in _STEPS[transition][1]:
            return changed.state
        callback = f"on_{transition}"
        if changed.result == "no answer":
            raise NotReadyError(
                f"{name} could not {transition}: {callback} did not return within "
                f"{deadline.timeout_s:g} s{child.last_output()}",
                hint="Increase benchmark.start_timeout, or find out in its output what it waits "
                f"for: {child.log}",
                code=TRANSITION_FAILED,
                blamed=name,
            )
        # A Python process says what the callback has raised.
        begin = protocol.callback_failure(name, callback)
        lines = reversed(child.log_tail().splitlines())
        raised = next((line.removeprefix(begin) for line in lines if line.startswith(begin)), "")
        cause = f"{callback} {raised or _CAUSES[changed.result]}"
        now = f"; it is {changed.state} now" if changed.state else ""
        raise _mismatch(
            TRANSITION_FAILED,
            name,
            transition,
            f"{name} could not {transition}: {cause}{now}",
            f"correct it, or read the whole output of the node: {child.log}",
            "" if raised else child.last_output().removeprefix("; "),
        )

    def never_active(self, missing: Collection[str]) -> frozenset[str]:
        """Return the topics that miss endpoints of nodes which nothing in the graph can activate.

        Raises:
            RunError: the observer does not answer.
        """
        waiting = self.waiting(missing)
        certain = bool(waiting) and not any(each.managers for each in waiting)
        return frozenset(missing) if certain and not self._has_unknown_programs() else frozenset()

    def _has_unknown_programs(self) -> bool:
        """Return whether a program may be there to change states, although it has no client now."""
        return any(each.phase == self.phase for each in self.plan.external) or any(
            not has_planned_name(process, node)
            for process in self._processes()
            for node in process.nodes
        )

    def waiting(self, topics: Iterable[str]) -> tuple[WaitingNode, ...]:
        """Return the inactive nodes for which topics without messages may be waiting.

        A node whose state is in the plan has been brought there, and is not among them.

        Raises:
            RunError: the observer does not answer.
        """
        found = self._ask_states()
        if not found.states:
            return ()
        topics = {*topics}
        planned = [
            {*topic.writers, *topic.readers} - {*HARNESS_PARTS}
            for topic in self.plan.topics
            if topic.phase == self.phase and topic.name in topics
        ]
        # What publishes or reads a topic may be unknown.
        anyone = len(planned) < len(topics) or not all(planned)
        own = {node.name for process in self._processes() for node in process.nodes}
        waiting = []
        for name, state in found.states.items():
            is_planned = name in self.plan.states_in(self.phase)
            is_near = anyone or any(name in nodes for nodes in planned)
            if state in {"unconfigured", "inactive"} and is_near and not is_planned:
                managers = found.managers.get(name, ())
                waiting.append(WaitingNode(_not_activated(name, state, managers, own), managers))
        return tuple(waiting)

    def _processes(self) -> tuple[ProcessPlan, ...]:
        return self.plan.processes_in(self.phase)


class WaitingNode(NamedTuple):
    """A node that is not active, and the nodes that can activate it."""

    difference: Difference
    managers: tuple[str, ...]


def _not_activated(
    name: str, state: str, managers: Collection[str], own: Collection[str]
) -> Difference:
    """Return a lifecycle node that is not active, and of which the spec does not say so.

    Args:
        name: its full name.
        state: that it is in.
        managers: the nodes that can change it.
        own: the nodes that the run has started.
    """
    if managers:
        why = f"{' and '.join(managers)} could activate it, and did not"
        way_out = f"find the cause in the output of {' and '.join(managers)}"
    else:
        why = "nothing in the graph activates it"
        way_out = "let its launch file, or a lifecycle manager, configure and activate it"
        if name in own:
            way_out = "write 'lifecycle: active', and the run configures and activates it"
    return Difference(
        code=NOT_ACTIVATED,
        message=f"{name} is a lifecycle node and {state}: {why}",
        part="lifecycle",
        owner=name,
        name=state,
        help=way_out,
    )


_CAUSES: Final = {
    "failure": "returned FAILURE",
    "error": "returned ERROR, or raised an exception",
    "unknown": "did not succeed",
}


def _mismatch(
    code: str, name: str, transition: str, message: str, help_text: str, details: str = ""
) -> GraphDifferencesError:
    difference = Difference(
        code=code, message=message, part="lifecycle", owner=name, name=transition, help=help_text
    )
    return GraphDifferencesError([difference], f"{message}{details}", details=details)
