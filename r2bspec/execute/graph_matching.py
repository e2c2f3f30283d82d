"""Waiting until all planned endpoints are matched, and both sides have discovered each other.

The subscriptions of the monitor are created when their quality of service is known. The graph is
ready when every planned endpoint is matched, and then both sides must have discovered each other.
At the deadline, the error names the endpoints that are not. Before it, the graph is observed once a
second while endpoints are missing (`r2bspec.execute.diagnose.diagnosis`).
"""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass

import msgspec

from r2bspec.execute.bringup.readiness import IdleNodes, StartDeadline, patience_s
from r2bspec.execute.diagnose.diagnosis import EarlyDiagnosis, PhaseGraph, faults_of
from r2bspec.execute.processes.supervisor import ManagedProcess, ProcessSupervisor
from r2bspec.ipc import protocol
from r2bspec.ipc.protocol import weakest_offer
from r2bspec.plan.plan import HARNESS_PARTS, MonitorPlan

EndpointKey = tuple[str, str, str]
"""An endpoint: topic, type, and ``publishes`` or ``subscribes``."""

_POLL_S = 0.02
_MAX_DISCOVERY_S = 5.0


@dataclass
class MonitorSubscriptions:
    """Subscribes the monitor; a topic without a QoS waits until its publisher is discovered.

    Attributes:
        supervisor: all processes.
        monitor: has been configured.
        waiting: the topics that it has not subscribed to yet.
    """

    supervisor: ProcessSupervisor
    monitor: ManagedProcess
    waiting: tuple[MonitorPlan, ...]

    def update(self) -> None:
        """Subscribe to the topics whose QoS is known by now.

        Raises:
            RunError: a process does not respond, or exited.
        """
        topics = tuple(monitor.topic for monitor in self.waiting if monitor.qos is None)
        writers: Mapping[str, tuple[protocol.Endpoint, ...]] = {}
        if topics:
            command = protocol.Discover(topics=topics)
            writers = self.supervisor.ask_observer(command, protocol.Discovered).writers
        ready = tuple(
            msgspec.structs.replace(
                monitor, qos=monitor.qos or weakest_offer(writers[monitor.topic])
            )
            for monitor in self.waiting
            if monitor.qos is not None or writers[monitor.topic]
        )
        names = {monitor.name for monitor in ready}
        self.waiting = tuple(monitor for monitor in self.waiting if monitor.name not in names)
        if ready:
            subscribe = protocol.Subscribe(monitors=ready)
            self.supervisor.request(self.monitor, subscribe, protocol.Matched)


def wait_until_matched(
    graph: PhaseGraph,
    expected_matches: Mapping[ManagedProcess, Mapping[str, int]],
    deadline: StartDeadline,
    subscribe: Callable[[], None] = lambda: None,
) -> None:
    """Wait until the endpoints of the harness are matched; report once which are missing.

    Args:
        graph: the graph of the phase that starts.
        expected_matches: for each harness process, its topics, and with how many endpoints of
            other processes each must be matched.
        deadline: the deadline of the start.
        subscribe: to what could not be subscribed to before.

    Raises:
        GraphDifferencesError: an endpoint is not matched, and never will be.
        NotReadyError: an endpoint is not matched at the deadline, or the nodes are idle, for
            another reason.
    """
    idle = IdleNodes(graph.plan, graph.phase, graph.supervisor)
    patience = patience_s(graph.plan.start_timeout.seconds)
    diagnosis = EarlyDiagnosis(
        patience, lambda: graph.observer.look(), idle_s=idle.update, answer=idle.answer
    )
    told = False
    while True:
        subscribe()
        missing: dict[str, tuple[int, int]] = {}
        for child, topics in expected_matches.items():
            counts = graph.supervisor.request(
                child, protocol.CountMatches(), protocol.Matched
            ).counts
            missing |= {
                topic: (counts.get(topic, 0), count)
                for topic, count in topics.items()
                if counts.get(topic, 0) < count
            }
        if not missing:
            # Those of which something in the graph has changed the states.
            graph.launcher.describe_lifecycle_nodes()
            return
        if diagnosis.is_hopeless(missing) or deadline.over:
            raise graph.not_ready_error(missing, diagnosis.stalled_s, is_over=deadline.over)
        if diagnosis.facts is not None and not told:
            told = True
            faults = faults_of(diagnosis.facts, missing)
            graph.note(f"not ready so far: {'; '.join(fault.message for fault in faults)}")
        graph.supervisor.pump(_POLL_S)


def subscription_counts(graph: PhaseGraph, topics: Iterable[str]) -> dict[str, int]:
    """Return the number of subscriptions to each topic among the Python nodes that have started."""
    subscribed = Counter(
        topic for _, topic, _, does in graph.launcher.endpoints if does == "subscribes"
    )
    return {topic: subscribed[topic] for topic in topics}


def expected_subscriptions(graph: PhaseGraph, topic: str) -> int:
    """Return how many subscriptions a topic of the harness must match; at least one."""
    nodes = {
        node
        for planned in graph.plan.topics
        if planned.name == topic and planned.phase == graph.phase
        for node in planned.readers
    }
    return max(1, len(nodes - {*HARNESS_PARTS}))


def wait_for_mutual_discovery(graph: PhaseGraph, harness_endpoints: Iterable[EndpointKey]) -> None:
    """Wait until the nodes and the harness have discovered each other from both sides.

    A publisher may have discovered a subscription that has not yet discovered the publisher;
    messages published in this time are lost. The wait is bounded by `_MAX_DISCOVERY_S`: some
    pairs never match, for example those with incompatible QoS.

    Args:
        graph: the graph of the phase that starts.
        harness_endpoints: the harness's own endpoints, as (topic, type, ``publishes`` or
            ``subscribes``).
    """
    launcher, supervisor = graph.launcher, graph.supervisor
    of_nodes = ((topic, kind, does) for _, topic, kind, does in launcher.endpoints)
    opposite = {"publishes": "subscribes", "subscribes": "publishes"}
    counterparts = Counter(
        (topic, kind, opposite[does]) for topic, kind, does in (*of_nodes, *harness_endpoints)
    )
    deadline = time.monotonic() + _MAX_DISCOVERY_S
    undiscovered = {
        child: {(*end,) for node, *end in launcher.endpoints if node in nodes}
        for child, nodes in launcher.hosts.items()
    }
    while any(undiscovered.values()) and time.monotonic() < deadline:
        for child, waiting in undiscovered.items():
            if waiting:
                found = supervisor.request(child, protocol.CountMatches(), protocol.Matched)
                counts = {"publishes": found.counts, "subscribes": found.publisher_counts}
                waiting -= {
                    (topic, kind, does)
                    for topic, kind, does in waiting
                    if counts[does].get(topic, 0) >= counterparts[topic, kind, does]
                }
        supervisor.pump(_POLL_S)
