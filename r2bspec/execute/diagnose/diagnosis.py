"""Why the graph of a phase is not ready, or gives no output: the error, and when it is certain.

A fault is what `r2bspec.execute.diagnose.first_fault` finds on the path of the messages. A start
ends before its deadline if two endpoints never match and the graph has not changed since
`_UNCHANGED_S`, or if it is stalled: it has not changed for longer, and all its nodes are idle
(`r2bspec.execute.bringup.readiness`).
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import KW_ONLY, dataclass

import msgspec

from r2bspec.execute.bringup.launcher import Launcher
from r2bspec.execute.bringup.lifecycle import LifecycleNodes
from r2bspec.execute.bringup.node_faults import (
    RemappedTopic,
    find_undeclared,
    nodes_with_one_name,
    unmatched_remapping,
)
from r2bspec.execute.diagnose import first_fault
from r2bspec.execute.diagnose.facts import GraphFacts, GraphObserver
from r2bspec.execute.errors import GraphDifferencesError, NotReadyError, RunError
from r2bspec.execute.processes.supervisor import ProcessSupervisor
from r2bspec.middleware.middleware import discovery_settings
from r2bspec.plan.command_lines import has_planned_name
from r2bspec.plan.plan import Plan
from r2bspec.plan.wiring.name_resolution import expand
from r2bspec.record.run_record import Difference

_NO_FAULT = "publishers and subscriptions are matched, and no fault was found"

_LOOK_S = 1.0
_UNCHANGED_S = 4.0
"""A node creates its endpoints one after another, usually within milliseconds; on a busy machine
discovery may show them seconds apart."""


@dataclass(frozen=True)
class PhaseGraph:
    """The graph of one phase, from its start on.

    Attributes:
        plan: the plan of the run.
        phase: ``preprocess`` or ``measure``.
        supervisor: all processes.
        launcher: has started the nodes.
        note: is told what the user should know.
    """

    plan: Plan
    phase: str
    supervisor: ProcessSupervisor
    launcher: Launcher
    note: Callable[[str], None]

    @property
    def lifecycle(self) -> LifecycleNodes:
        """The lifecycle nodes of the graph."""
        return LifecycleNodes(self.plan, self.phase, self.supervisor, self.note)

    @property
    def observer(self) -> GraphObserver:
        """The observer of the graph."""
        plan, phase = self.plan, self.phase
        nodes = {node.name for process in plan.processes_in(phase) for node in process.nodes}
        known = tuple(each for each in self.launcher.endpoints if each[0] in nodes)
        return GraphObserver(self.supervisor, plan, phase, known)

    def not_ready_error(
        self, missing: Mapping[str, tuple[int, int]], stalled_s: float, *, is_over: bool
    ) -> RunError:
        """Return the error that names the first fault on each path.

        Args:
            missing: the topics, with the matches that they have and need.
            stalled_s: for how long nothing has changed; 0 if the nodes are not idle.
            is_over: whether the deadline is over.
        """
        facts = self.observer.observe()
        self.add_unmatched_remappings(facts, missing)
        state = "will not be ready"
        if stalled_s:
            state = f"is not ready and has not changed for {stalled_s:.0f} s, with all nodes idle"
        elif is_over:
            state = f"was not ready after {self.plan.start_timeout.seconds:g} s"
        counted = ", ".join(
            f"{topic}: {have} of {want} endpoints matched"
            for topic, (have, want) in missing.items()
        )
        hint = "Check remappings, message types and QoS of the nodes on these topics."
        unread = [topic for topic in missing if topic in facts.inputs and not missing[topic][0]]
        if unread:
            hint = (
                f"Remove inputs that no node reads ({', '.join(unread)}); 'r2bspec interfaces "
                f"SPEC' shows what nodes subscribe to. {hint}"
            )
        return self.error(
            facts,
            faults_of(facts, missing),
            [topic for topic in missing if topic not in facts.inputs] or missing,
            f"the {self.phase} graph {state} ({counted})",
            hint,
            otherwise=NotReadyError,
            names_related=False,
        )

    def error(
        self,
        facts: GraphFacts,
        faults: Sequence[Difference],
        silent: Iterable[str],
        state: str,
        hint: str,
        *,
        otherwise: type[RunError],
        names_related: bool = True,
    ) -> RunError:
        """Return the error for a graph whose messages do not arrive, with the complete path.

        Args:
            facts: the facts of the graph.
            faults: on the paths of the messages.
            silent: the topics at the ends of these paths.
            state: the state of the graph, in words.
            hint: for the error if the graph does not clearly differ from the spec.
            otherwise: the error without a certain fault; another attempt might succeed.
            names_related: whether it says what else is wrong with the nodes that have faults.
        """
        known = self.launcher.differences
        waiting = self.lifecycle.waiting([*silent, *(fault.name for fault in faults)])
        differences = waiting or graph_mismatches(faults, known, self._is_permanent)
        sentences = [each.message for each in (*waiting, *faults)] or [_NO_FAULT]
        also = related_differences(faults, known) if names_related else ""
        path = dict.fromkeys(
            name for topic in silent for name in first_fault.full_path(facts, topic)
        )

        def text(said: Collection[str] = ()) -> str:
            left = "; ".join(sentence for sentence in sentences if sentence not in said) + also
            head = f"{state}: {left.removeprefix('; ')}" if left else state
            return "\n".join([head, *first_fault.path_lines(facts, path)])

        env = {process.name: process.env for process in self.plan.processes_in(self.phase)}
        if settings := discovery_settings(
            os.environ, self.plan.transport, self.plan.environment, env
        ):
            differences = tuple(
                msgspec.structs.replace(each, help=f"{settings}. {each.help}".rstrip(" ."))
                for each in differences
            )
            hint = f"{settings[0].upper()}{settings[1:]}. {hint}"
        if not differences:
            return otherwise(text(), hint=hint)
        details = text({difference.message for difference in differences})
        return GraphDifferencesError(
            differences, text(), differences[0].help or hint, details=details
        )

    def _is_permanent(self, fault: Difference) -> bool:
        """Return whether a fault persists, so that neither a longer wait nor another attempt helps.

        A mismatch of two existing endpoints persists. A missing endpoint persists once its node
        has been created; nodes of others, which may own it, may still create it.
        """
        if fault.code in first_fault.NEVER_MATCHED:
            return True
        has_external = any(node.phase == self.phase for node in self.plan.external)
        is_unknown = not fault.owner.startswith("/")
        return not (is_unknown and has_external) and self.launcher.has_created(fault.owner)

    def check_parameters(self) -> None:
        """Ask nodes outside of Python hosts for their parameters, and report undeclared parameters.

        Raises:
            GraphDifferencesError: a node does not declare a parameter that is certainly misspelt.
            RunError: the observer does not respond.
        """
        differences = find_undeclared(
            self.plan, self.phase, self.launcher.programs, self.supervisor
        )
        for difference in differences:
            self.note(f"{difference.message}; ROS ignores it")
        self.launcher.differences += differences
        plans = {process.name: process for process in self.plan.processes_in(self.phase)}
        for child in self.supervisor:
            if child.name in plans:
                self.launcher.differences += nodes_with_one_name(plans[child.name], child.log)

    def remapped_topics(self) -> tuple[RemappedTopic, ...]:
        """Return the topics to which the plan remaps the names of nodes."""
        return tuple(
            RemappedTopic(
                node.name,
                before,
                expand(after, node.node, node.namespace),
                has_planned_name(process, node),
            )
            for process in self.plan.processes_in(self.phase)
            for node in process.nodes
            for before, after in node.remappings.items()
        )

    def add_unmatched_remappings(self, facts: GraphFacts, topics: Collection[str]) -> None:
        """Record remappings to some topics that discovery shows to have no effect.

        Those of Python nodes, which say so themselves, are already recorded.
        """
        known = self.launcher.known_differences
        rules = [rule for rule in self.remapped_topics() if rule.topic in topics]
        self.launcher.differences += [
            unmatched_remapping(rule.node, rule.before, rule.topic, facts.topics_of(rule.node))
            for rule in first_fault.unmatched(facts, rules)
            if (rule.node, rule.before) not in known
        ]


def faults_of(facts: GraphFacts, missing: Iterable[str]) -> tuple[Difference, ...]:
    """Return the faults of topics whose endpoints are not matched, inputs or not."""
    inputs = [topic for topic in missing if topic in facts.inputs]
    return first_fault.find_faults(
        facts, [topic for topic in missing if topic not in inputs], inputs
    )


def graph_mismatches(
    faults: Iterable[Difference],
    launch_differences: Iterable[Difference],
    is_permanent: Callable[[Difference], bool] = lambda _: True,
) -> tuple[Difference, ...]:
    """Return the differences between the graph and the plan, causes before consequences.

    A remapping that changed no name is the cause of a fault on the topic that it names; that fault
    is then not reported separately.

    Args:
        faults: on the paths of messages. A node without output is not a difference.
        launch_differences: found when the nodes were created.
        is_permanent: whether a fault persists; only these are differences.
    """
    faults = [fault for fault in faults if fault.code != first_fault.NO_OUTPUT]
    missing = {fault.name for fault in faults}
    causes = [
        msgspec.structs.replace(difference, harmless=False)
        for difference in launch_differences
        if difference.topic and difference.topic in missing
    ]
    explained = {difference.topic for difference in causes}
    consequences = (
        fault for fault in faults if fault.name not in explained and is_permanent(fault)
    )
    return (*causes, *consequences)


def related_differences(
    faults: Iterable[Difference], launch_differences: Iterable[Difference]
) -> str:
    """Return the other differences of nodes with faults, as text to append to a sentence."""
    owners = {fault.owner for fault in faults}
    return "".join(f"; {each.message}" for each in launch_differences if each.owner in owners)


@dataclass
class EarlyDiagnosis:
    """Observes a graph that is not ready, before its deadline.

    Args:
        patience_s: for how long all nodes of a stalled graph have been idle.
        observe: returns the facts of the graph, as discovery shows them now.
        clock: a monotonic clock in seconds.
        idle_s: for how many seconds the nodes have been idle.
        answer: whether all nodes answer, which takes a while.

    Attributes:
        facts: the facts of the graph, once it has not changed for a while; None before.
        stalled_s: for how many seconds a stalled graph has not changed; 0 for any other.
    """

    patience_s: float
    observe: Callable[[], GraphFacts]
    clock: Callable[[], float] = time.monotonic
    _: KW_ONLY
    idle_s: Callable[[], float] = lambda: 0.0
    answer: Callable[[], bool] = lambda: False
    facts: GraphFacts | None = None
    stalled_s: float = 0.0
    _last: GraphFacts | None = None

    def __post_init__(self) -> None:
        self._unchanged_since = self._next = self.clock() + _LOOK_S

    def is_hopeless(self, missing: Collection[str]) -> bool:
        """Return True if topics will never be matched, or the graph is stalled.

        Raises:
            RunError: the observing process does not answer.
        """
        now = self.clock()
        if now < self._next:
            return False
        facts = self.observe()
        now = self.clock()
        self._next = now + _LOOK_S
        if facts != self._last:
            self._last, self._unchanged_since = facts, now
        unchanged_s = now - self._unchanged_since
        # Asked at every look, because it compares with the one before.
        quiet_s = min(unchanged_s, self.idle_s())
        if unchanged_s < _UNCHANGED_S:
            return False
        self.facts = facts
        if quiet_s >= self.patience_s and self.answer():
            self.stalled_s = unchanged_s
        faults = faults_of(facts, missing)
        return self.stalled_s > 0 or any(
            fault.code in first_fault.NEVER_MATCHED and fault.name in missing for fault in faults
        )
