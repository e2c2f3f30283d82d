"""Lifecycle nodes: brought into the states of the spec, or recognised if the spec has none.

The endpoints of such a node may exist only once it is configured, so its state is changed before
they are waited for. All nodes are configured, then activated, each time in the order of the spec. A
node whose state the spec does not mention is left alone: something in the graph, such as a
lifecycle manager, activates it. If nothing does, the error of the start says so.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Final

from r2bspec.execute.bringup.readiness import StartDeadline
from r2bspec.execute.errors import GraphDifferencesError, NotReadyError, ProcessDiedError
from r2bspec.execute.processes.supervisor import REPLY_TIMEOUT_S, ProcessSupervisor
from r2bspec.ipc import protocol
from r2bspec.language.spec import LifecycleState
from r2bspec.plan.plan import HARNESS_PARTS, Plan, ProcessPlan
from r2bspec.record.run_record import Difference

TRANSITION_FAILED: Final = "R2B605"
NOT_ACTIVATED: Final = "R2B237"

_STEPS: Final[dict[protocol.Transition, tuple[str, frozenset[LifecycleState]]]] = {
    "configure": ("unconfigured", frozenset({"inactive", "active"})),
    "activate": ("inactive", frozenset({"active"})),
}
"""Each transition: the state that it leads from, and the wanted states that need it."""

_PRIMARY_STATES: Final = frozenset({"unconfigured", "inactive", "active", "finalized"})
"""In every other state a callback runs."""

_ASK_NS = 2_000_000_000
_POLL_S = 0.1


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
            GraphDifferencesError: a transition failed.
            NotReadyError: a node is not there in time, or does not answer.
        """
        wanted = self.plan.states_in(self.phase)
        if not wanted:
            return
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
            NotReadyError: a node is not there in time, or does not report its state.
        """
        while True:
            found = self._ask_states()
            missing = [name for name in wanted if found.states.get(name) not in _PRIMARY_STATES]
            if not missing:
                return found.states
            if deadline.over:
                lacks = "does not report its state"
                if missing[0] not in found.states:
                    lacks = f"did not appear within {deadline.timeout_s:g} s, with change_state"
                raise NotReadyError(
                    f"lifecycle node {missing[0]} {lacks}",
                    hint="Remove 'lifecycle' if it has no states; else read its output, or "
                    "increase benchmark.start_timeout.",
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
        now = f"; it is {changed.state} now" if changed.state else ""
        raise _mismatch(
            TRANSITION_FAILED,
            name,
            transition,
            f"{name} could not {transition}: {callback} did not succeed{now}",
            f"correct it, or read the whole output of the node: {child.log}",
            child.last_output().removeprefix("; "),
        )

    def waiting(self, topics: Iterable[str]) -> tuple[Difference, ...]:
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
                waiting.append(_not_activated(name, state, is_own=name in own))
        return tuple(waiting)

    def _processes(self) -> tuple[ProcessPlan, ...]:
        return self.plan.processes_in(self.phase)


def _not_activated(name: str, state: str, *, is_own: bool) -> Difference:
    """Return a lifecycle node that is not active, and of which the spec does not say so."""
    return Difference(
        code=NOT_ACTIVATED,
        message=f"{name} is a lifecycle node and {state}: nothing has activated it",
        part="lifecycle",
        owner=name,
        name=state,
        help="write 'lifecycle: active', and the run configures and activates it"
        if is_own
        else "let its launch file, or a lifecycle manager, configure and activate it",
    )


def _mismatch(
    code: str, name: str, transition: str, message: str, help_text: str, details: str = ""
) -> GraphDifferencesError:
    difference = Difference(
        code=code, message=message, part="lifecycle", owner=name, name=transition, help=help_text
    )
    return GraphDifferencesError([difference], f"{message}{details}", details=details)
