"""Whether all planned endpoints are matched, and the end of a start in which they never will be.

The subscriptions of the monitor are created when their quality of service is known. The graph is
ready when every planned endpoint is matched, and then both sides must have discovered each other.
At the deadline, the error names the endpoints that are not.

Before the deadline the graph is observed once a second while endpoints are missing. A fault is
certain if `r2bspec.execute.bringup.find_fault` finds it, and if the graph has not changed
since `_UNCHANGED_S`: until then a node may still create or replace endpoints. A graph that has not
changed for longer, and whose nodes are idle (`r2bspec.execute.bringup.readiness`), is stalled.
"""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass

import msgspec

from r2bspec.execute.bringup.find_fault import (
    Fault,
    FaultReport,
    RemappedTopic,
    certain_topics,
    fault_report,
    find_faults,
    unmatched,
)
from r2bspec.execute.bringup.launcher import Launcher
from r2bspec.execute.bringup.observe_graph import (
    GraphFacts,
    GraphObserver,
    weakest_offer,
)
from r2bspec.execute.bringup.readiness import IdleNodes, StartDeadline, patience_s
from r2bspec.execute.bringup.spec_mismatches import (
    graph_mismatches,
)
from r2bspec.execute.errors import GraphMismatchError, NotReadyError, RunError
from r2bspec.execute.processes.supervisor import ManagedProcess, ProcessSupervisor
from r2bspec.ipc import protocol
from r2bspec.plan.plan import MonitorPlan, Plan
from r2bspec.wiring.name_resolution import expand

EndpointKey = tuple[str, str, str]
"""An endpoint: topic, type, and ``publishes`` or ``subscribes``."""

_POLL_S = 0.02
_MAX_DISCOVERY_S = 5.0

_LOOK_S = 1.0
_UNCHANGED_S = 4.0
"""A node creates its endpoints one after another, usually within milliseconds; on a busy machine
discovery may show them seconds apart."""


@dataclass
class MonitorSubscriptions:
    """Subscribes the monitor; a topic without a QoS waits until its publisher is discovered.

    Attributes:
        supervisor: all processes.
        observer: says what discovery shows.
        monitor: has been configured.
        waiting: the topics that it has not subscribed to yet.
    """

    supervisor: ProcessSupervisor
    observer: ManagedProcess
    monitor: ManagedProcess
    waiting: tuple[MonitorPlan, ...]

    def update(self) -> None:
        """Subscribe to what can be subscribed to now.

        Raises:
            RunError: a process does not respond, or exited.
        """
        if not self.waiting:
            return
        found = self._discover(tuple(each.topic for each in self.waiting if each.qos is None))
        ready = tuple(
            msgspec.structs.replace(each, qos=each.qos or weakest_offer(found.writers[each.topic]))
            for each in self.waiting
            if each.qos is not None or found.writers[each.topic]
        )
        names = {each.name for each in ready}
        self.waiting = tuple(each for each in self.waiting if each.name not in names)
        if ready:
            command = protocol.Subscribe(monitors=ready)
            self.supervisor.request(self.monitor, command, protocol.Matched)

    def _discover(self, topics: tuple[str, ...]) -> protocol.Discovered:
        if not topics:
            return protocol.Discovered(writers={}, readers={})
        command = protocol.Discover(topics=topics)
        return self.supervisor.request(self.observer, command, protocol.Discovered)


def wait_until_matched(
    supervisor: ProcessSupervisor,
    launcher: Launcher,
    expected_matches: dict[ManagedProcess, dict[str, int]],
    plan: Plan,
    phase: str,
    deadline: StartDeadline,
    note: Callable[[str], None],
    subscribe: Callable[[], None] = lambda: None,
) -> None:
    """Wait until the endpoints of the harness are matched.

    Args:
        supervisor: all processes.
        launcher: has the endpoints of the nodes.
        expected_matches: for each harness process, its topics, and with how many endpoints of
            other processes each must be matched.
        plan: for the text of errors.
        phase: ``preprocess`` or ``measure``.
        deadline: of the start.
        note: is told once what is missing, while the start is still waited for.
        subscribe: to what could not be subscribed to before.

    Raises:
        GraphMismatchError: an endpoint is not matched, and never will be.
        NotReadyError: an endpoint is not matched at the deadline, or the nodes are idle, for
            another reason.
    """
    idle = IdleNodes(plan, phase, supervisor)
    diagnosis = EarlyDiagnosis(
        plan,
        phase,
        lambda: graph_observer(supervisor, launcher, plan, phase).look(),
        idle_s=idle.update,
        answer=lambda: idle.answer(supervisor.observer()),
    )
    told = False
    while True:
        subscribe()
        missing: dict[str, tuple[int, int]] = {}
        for child, wanted in expected_matches.items():
            matched = supervisor.request(child, protocol.CountMatches(), protocol.Matched)
            missing |= {
                topic: (matched.counts.get(topic, 0), count)
                for topic, count in wanted.items()
                if matched.counts.get(topic, 0) < count
            }
        if not missing:
            return
        certain = diagnosis.certain(missing)
        if certain or diagnosis.stalled_s or deadline.over:
            raise _not_ready_error(
                supervisor, launcher, plan, phase, missing, certain, diagnosis.stalled_s
            )
        if diagnosis.facts is not None and not told:
            told = True
            silent = [topic for topic in missing if topic not in diagnosis.facts.inputs]
            inputs = [topic for topic in missing if topic in diagnosis.facts.inputs]
            faults = find_faults(diagnosis.facts, silent, inputs)
            note(f"not ready so far: {'; '.join(each.sentence for each in faults)}")
        supervisor.pump(_POLL_S)


def graph_observer(
    supervisor: ProcessSupervisor,
    launcher: Launcher,
    plan: Plan,
    phase: str,
    monitor: ManagedProcess | None = None,
) -> GraphObserver:
    """Observes the graph of a phase; with a monitor, messages can be traced."""
    known = tuple(launcher.endpoints_in(plan, phase))
    return GraphObserver(supervisor, supervisor.observer(), plan, phase, known, monitor)


def _not_ready_error(
    supervisor: ProcessSupervisor,
    launcher: Launcher,
    plan: Plan,
    phase: str,
    missing: dict[str, tuple[int, int]],
    certain: Collection[str],
    stalled_s: float,
) -> RunError:
    """The error that names the first fault on each path.

    Args:
        supervisor: all processes.
        launcher: has the endpoints of the nodes.
        plan: of the run.
        phase: ``preprocess`` or ``measure``.
        missing: the topics, with the matches that they have and need.
        certain: those that will never be matched, if that was found before the deadline.
        stalled_s: for how long nothing has changed; 0 if the nodes are not idle.
    """
    facts = graph_observer(supervisor, launcher, plan, phase).observe()
    remapped = [each for each in remapped_topics(plan, phase) if each.topic in {*missing}]
    launcher.add_unmatched_remappings(unmatched(facts, remapped), facts)
    inputs = [topic for topic in missing if topic in facts.inputs]
    silent = [topic for topic in missing if topic not in facts.inputs]
    faults = find_faults(facts, silent, inputs)
    state = f"was not ready after {plan.start_timeout_ns / 1e9:g} s"
    if certain:
        state = "will not be ready"
    elif stalled_s:
        state = f"is not ready and has not changed for {stalled_s:.0f} s, with all nodes idle"
    counted = ", ".join(
        f"{topic}: {have} of {want} endpoints matched" for topic, (have, want) in missing.items()
    )
    return graph_error(
        launcher,
        faults,
        f"the {phase} graph {state} ({counted})",
        fault_report(facts, silent or inputs, faults),
        otherwise=NotReadyError,
        hint="Check remappings, message types and QoS of the nodes on these topics.",
        certain=certain,
    )


def graph_error(
    launcher: Launcher,
    faults: Sequence[Fault],
    state: str,
    report: FaultReport,
    *,
    otherwise: type[RunError],
    hint: str,
    certain: Collection[str] = (),
) -> RunError:
    """The error for a graph whose messages do not arrive.

    Args:
        launcher: has the nodes.
        faults: on the paths of the messages.
        state: of the graph, in words.
        report: on the faults.
        otherwise: the error if the graph does not clearly differ from the spec, so that another
            attempt might succeed.
        hint: for that error.
        certain: topics whose faults persist in any case.
    """
    differences = graph_mismatches(
        faults,
        launcher.differences,
        lambda each: each.topic in certain or launcher.is_permanent(each),
    )
    if differences:
        return GraphMismatchError(
            differences,
            report.text(state),
            differences[0].help or hint,
            details=report.text(state, {each.message for each in differences}),
        )
    return otherwise(report.text(state), hint=hint)


def subscription_counts(launcher: Launcher, topics: Iterable[str]) -> dict[str, int]:
    """How many subscriptions each topic has among the Python nodes that have been started."""
    return {
        topic: sum(
            name == topic and does == "subscribes" for _, name, _, does in launcher.endpoints
        )
        for topic in topics
    }


def expected_subscriptions(plan: Plan, topic: str, phase: str) -> int:
    """How many subscriptions a topic of the harness must match: those planned, at least one."""
    planned = (each for each in plan.topics if each.name == topic and each.phase == phase)
    subscribers = {
        node for each in planned for node in each.readers if node not in {"loader", "monitor"}
    }
    return max(1, len(subscribers))


def wait_for_mutual_discovery(
    supervisor: ProcessSupervisor, launcher: Launcher, harness_endpoints: Iterable[EndpointKey]
) -> None:
    """Wait until the nodes and the harness have discovered each other from both sides.

    A publisher may have discovered a subscription that has not yet discovered the publisher;
    messages published in this time are lost. The wait is bounded by `_MAX_DISCOVERY_S`: some
    pairs never match, for example those with incompatible QoS.

    Args:
        supervisor: all processes.
        launcher: has the nodes that can be queried.
        harness_endpoints: the harness's own endpoints, as (topic, type, ``publishes`` or
            ``subscribes``).
    """
    known = [(topic, kind, does) for _, topic, kind, does in launcher.endpoints] + [
        *harness_endpoints
    ]
    publishers = Counter((topic, kind) for topic, kind, does in known if does == "publishes")
    subscriptions = Counter((topic, kind) for topic, kind, does in known if does == "subscribes")
    deadline = time.monotonic() + _MAX_DISCOVERY_S
    undiscovered = {child: {*launcher.host_endpoints(child)} for child in launcher.hosts}
    with supervisor.waiting("nodes: discovery of the harness"):
        while any(undiscovered.values()) and time.monotonic() < deadline:
            for child, waiting in undiscovered.items():
                if waiting:
                    found = supervisor.request(child, protocol.CountMatches(), protocol.Matched)
                    waiting -= {
                        (topic, kind, does)
                        for topic, kind, does in waiting
                        if (found.counts if does == "publishes" else found.publisher_counts).get(
                            topic, 0
                        )
                        >= (subscriptions if does == "publishes" else publishers)[topic, kind]
                    }
            supervisor.pump(_POLL_S)


class EarlyDiagnosis:
    """Observes a graph that is not ready.

    Args:
        plan: of the run.
        phase: ``preprocess`` or ``measure``.
        observe: returns the facts of the graph, as discovery shows them now.
        clock: a monotonic clock in seconds.
        idle_s: for how many seconds the nodes have been idle.
        answer: whether all nodes answer, which takes a while.

    Attributes:
        facts: of the graph, once it has not changed for a while; None before.
        stalled_s: for how many seconds a stalled graph has not changed; 0 for any other.
    """

    facts: GraphFacts | None = None
    stalled_s: float = 0.0

    def __init__(
        self,
        plan: Plan,
        phase: str,
        observe: Callable[[], GraphFacts],
        clock: Callable[[], float] = time.monotonic,
        *,
        idle_s: Callable[[], float] = lambda: 0.0,
        answer: Callable[[], bool] = lambda: False,
    ) -> None:
        self._observe = observe
        self._clock = clock
        self._idle_s = idle_s
        self._answer = answer
        self._patience_s = patience_s(plan)
        self._remapped = tuple(remapped_topics(plan, phase))
        self._last: GraphFacts | None = None
        self._unchanged_since = self._next = clock() + _LOOK_S

    def certain(self, missing: Collection[str]) -> frozenset[str]:
        """The missing topics that will never be matched; mostly, and at first, none.

        Raises:
            RunError: the observing process does not answer.
        """
        now = self._clock()
        if now < self._next:
            return frozenset()
        facts = self._observe()
        now = self._clock()
        self._next = now + _LOOK_S
        if facts != self._last:
            self._last, self._unchanged_since = facts, now
        unchanged_s = now - self._unchanged_since
        # Asked at every look, because it compares with the one before.
        quiet_s = min(unchanged_s, self._idle_s())
        if unchanged_s < _UNCHANGED_S:
            return frozenset()
        self.facts = facts
        if quiet_s >= self._patience_s and self._answer():
            self.stalled_s = unchanged_s
        return certain_topics(facts, missing, self._remapped)


def remapped_topics(plan: Plan, phase: str) -> Iterator[RemappedTopic]:
    """The topics to which a plan remaps the names of nodes."""
    for process in plan.processes:
        for node in process.nodes if process.phase == phase else ():
            own_name = process.role != "command" or f"__node:={node.node}" in process.argv
            for before, after in node.remappings.items():
                full = expand(after, node.node, node.namespace)
                yield RemappedTopic(node.name, before, full, own_name)
