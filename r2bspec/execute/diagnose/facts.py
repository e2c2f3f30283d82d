"""Facts of a graph: planned and discovered endpoints, counted messages, foreign publishers.

The running graph is observed: its endpoints and, while some steps are played, its messages. A
publisher that belongs to no process of the run spoils the measurement if it publishes on the topics
of the run: its messages are among the samples, or reach the nodes.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import msgspec

from r2bspec.execute.processes.supervisor import ManagedProcess, ProcessSupervisor
from r2bspec.ipc import protocol
from r2bspec.ipc.protocol import Endpoint, QosMismatch, weakest_offer
from r2bspec.ipc.sample_files import ArrivalReader, RowReader
from r2bspec.middleware.middleware import RMW_VARIABLE, middleware_of
from r2bspec.plan.plan import HARNESS_PARTS, MonitorPlan, Plan, TopicPlan
from r2bspec.plan.wiring.name_resolution import NODE_TOPICS
from r2bspec.record.sample_arrays import MONITOR_FIELDS

TRACE_RATE_HZ = 10.0
TRACE_STEPS = 10
"""Enough to tell a node that publishes rarely from one that never does."""

_PREFIX_DIGITS = 24

_MAX_MATCH_WAIT_S = 3.0
_QUIET_PERIOD_S = 0.5
_MAX_QUIET_WAIT_S = 5.0
_MAX_DISCOVERY_S = 10.0
"""Discovery takes a fraction of a second, and much longer on a busy machine."""

_POLL_S = 0.02
_DISCOVERY_INTERVAL_S = 0.3
_UNPLANNED = TopicPlan(name="", type="", phase="measure", writers=(), readers=())


@dataclass(frozen=True)
class TopicFacts:
    """The facts of one topic.

    Attributes:
        name: full name.
        type: as planned; empty if it, or the topic, is not in the plan.
        planned_publishers: nodes or parts of the harness.
        planned_subscribers: likewise.
        publishers: as discovered; parts of the harness have their names in plans.
        subscriptions: likewise, without those of the harness that only trace messages.
        qos_mismatches: pairs that never match, because the subscription requests a QoS that the
            publisher does not offer.
        passed: messages received on it while some steps were played; None if it was not observed.
    """

    name: str
    type: str = ""
    planned_publishers: tuple[str, ...] = ()
    planned_subscribers: tuple[str, ...] = ()
    publishers: tuple[Endpoint, ...] = ()
    subscriptions: tuple[Endpoint, ...] = ()
    qos_mismatches: tuple[QosMismatch, ...] = ()
    passed: int | None = None

    @property
    def publisher_nodes(self) -> tuple[str, ...]:
        """The nodes whose publishers were discovered."""
        return tuple(dict.fromkeys(end.node for end in self.publishers))

    @property
    def subscriber_nodes(self) -> tuple[str, ...]:
        """The nodes whose subscriptions were discovered."""
        return tuple(dict.fromkeys(end.node for end in self.subscriptions))

    @property
    def is_planned(self) -> bool:
        """Whether the plan has a publisher or a subscription of it."""
        return bool(self.planned_publishers or self.planned_subscribers)

    @cached_property
    def all_publishers(self) -> frozenset[str]:
        """The nodes that publish it, planned or discovered."""
        return frozenset(self.planned_publishers + self.publisher_nodes)

    @cached_property
    def all_subscribers(self) -> frozenset[str]:
        """The nodes that subscribe to it, planned or discovered."""
        return frozenset(self.planned_subscribers + self.subscriber_nodes)


@dataclass(frozen=True)
class GraphFacts:
    """The facts of a graph.

    Attributes:
        topics: every topic, planned or discovered, by name.
        inputs: the topics that the player or the loader publishes.
        played: steps that were played while the messages were counted; None if none were.
        nodes: the full names of the discovered nodes.
    """

    topics: Mapping[str, TopicFacts]
    inputs: tuple[str, ...]
    played: int | None = None
    nodes: frozenset[str] = frozenset()

    def topic(self, name: str) -> TopicFacts:
        """Return a topic by its name; without endpoints if nothing is known of it."""
        return self.topics.get(name, TopicFacts(name))

    @property
    def planned_nodes(self) -> frozenset[str]:
        """The nodes, and the parts of the harness, that the plan names."""
        topics = self.topics.values()
        return frozenset(
            name
            for topic in topics
            for name in (*topic.planned_publishers, *topic.planned_subscribers)
        )

    def topics_subscribed_by(self, node: str) -> tuple[str, ...]:
        """Return the topics to which a node subscribes, planned or discovered, sorted."""
        return tuple(sorted(name for name, t in self.topics.items() if node in t.all_subscribers))

    def topics_published_by(self, node: str) -> tuple[str, ...]:
        """Return the topics on which a node has a publisher, sorted."""
        return tuple(sorted(name for name, t in self.topics.items() if node in t.publisher_nodes))

    def topics_of(self, node: str) -> tuple[str, ...]:
        """Return the topics of a running node.

        Without such a node, return the topics of nodes that are not in the plan.
        """
        by_node: dict[str, dict[str, None]] = {}
        for name, topic in sorted(self.topics.items()):
            for owner in (*topic.publisher_nodes, *topic.subscriber_nodes):
                if owner not in HARNESS_PARTS:
                    by_node.setdefault(owner, {})[name] = None
        if node in by_node:
            return tuple(by_node[node])
        unplanned = by_node.keys() - self.planned_nodes
        names = (name for owner, names in by_node.items() if owner in unplanned for name in names)
        return tuple(dict.fromkeys(names))


def gather_facts(
    plan: Plan,
    phase: str,
    nodes: Iterable[str],
    discovered: protocol.Discovered,
    passed: Mapping[str, int] | None = None,
) -> GraphFacts:
    """Combine the plan with the observations.

    Args:
        plan: the plan of the run.
        phase: ``preprocess`` or ``measure``.
        nodes: the discovered nodes.
        discovered: publishers and subscriptions of each topic, and the pairs that never match.
        passed: messages counted, by topic, while `TRACE_STEPS` steps were played.
    """
    planned = {topic.name: topic for topic in plan.topics if topic.phase == phase}
    topics = {}
    for name in sorted({*planned, *discovered.writers}):
        topic = planned.get(name, _UNPLANNED)
        subscriptions = map(_with_plan_name, discovered.readers.get(name, ()))
        topics[name] = TopicFacts(
            name=name,
            type=topic.type,
            planned_publishers=topic.writers,
            planned_subscribers=topic.readers,
            publishers=tuple(map(_with_plan_name, discovered.writers.get(name, ()))),
            subscriptions=tuple(
                end
                for end in subscriptions
                if end.node not in HARNESS_PARTS or end.node in topic.readers
            ),
            qos_mismatches=tuple(
                QosMismatch(_plan_name(pair.writer), _plan_name(pair.reader), name, pair.why)
                for pair in discovered.qos_mismatches
                if pair.topic == name
            ),
            passed=None if passed is None else passed.get(name),
        )
    begin = "loader" if phase == "preprocess" else "player"
    return GraphFacts(
        topics=topics,
        inputs=tuple(name for name, topic in topics.items() if begin in topic.planned_publishers),
        played=None if passed is None else TRACE_STEPS,
        nodes=frozenset(nodes),
    )


def _plan_name(node: str) -> str:
    """Return the name of a node in the plan: of a part of the harness its role."""
    role = node.removeprefix("/r2bspec/")
    return role if role in HARNESS_PARTS else node


def _with_plan_name(end: Endpoint) -> Endpoint:
    return msgspec.structs.replace(end, node=_plan_name(end.node))


@dataclass(frozen=True)
class GraphObserver:
    """Observes the running graph.

    Attributes:
        supervisor: all processes.
        plan: the plan of the run.
        phase: ``preprocess`` or ``measure``.
        known: endpoints that exist for certain, as in `protocol.Ready`: discovery is incomplete
            until it shows all of them.
    """

    supervisor: ProcessSupervisor
    plan: Plan
    phase: str
    known: tuple[tuple[str, str, str, str], ...]

    def look(self) -> GraphFacts:
        """Return the endpoints that discovery shows at this moment; more may follow."""
        return gather_facts(self.plan, self.phase, *self._discover())

    def observe(self, passed: Mapping[str, int] | None = None) -> GraphFacts:
        """Return the endpoints of every topic, with the messages that were counted, if any."""
        return gather_facts(self.plan, self.phase, *self._wait_for_discovery(), passed)

    def trace(
        self, monitor: ManagedProcess, rows_dir: Path, play: Callable[[], None]
    ) -> GraphFacts:
        """Return all endpoints, and the messages on every topic while `TRACE_STEPS` are played.

        Args:
            monitor: counts the messages.
            rows_dir: the folder where the monitor's process writes its rows.
            play: plays the steps and returns when they have been published.
        """
        nodes, discovered = self._wait_for_discovery()
        # A run may be traced more than once, and a file of rows is never opened again.
        now = time.monotonic_ns()
        watches = tuple(
            MonitorPlan(
                name=f".look-{now}-{number}",
                topic=topic,
                type=publishers[0].type,
                match="order",
                # Not left to the monitor, which may have discovered less than the observer.
                qos=weakest_offer(publishers),
            )
            for number, (topic, publishers) in enumerate(discovered.writers.items())
            if publishers
        )
        self.supervisor.request(monitor, protocol.StartTap(monitors=watches), protocol.Matched)

        def are_matched() -> bool:
            matches = self.supervisor.request(monitor, protocol.CountMatches(), protocol.Matched)
            return all(matches.counts.get(watch.topic, 0) for watch in watches)

        self.supervisor.pump_until(are_matched, _MAX_MATCH_WAIT_S, _POLL_S)
        files = {
            watch.topic: ArrivalReader(path, MONITOR_FIELDS)
            for watch in watches
            if (path := rows_dir / f"{watch.name}.rows").exists()
        }
        # Messages that publishers keep for late subscriptions arrive now; they are not counted.
        wait_for_quiet(self.supervisor, files.values(), _QUIET_PERIOD_S, _MAX_QUIET_WAIT_S)
        before = {topic: rows.count() for topic, rows in files.items()}
        play()
        wait_for_quiet(self.supervisor, files.values(), _QUIET_PERIOD_S, _MAX_QUIET_WAIT_S)
        passed = {topic: rows.count() - before[topic] for topic, rows in files.items()}
        self.supervisor.request(monitor, protocol.StopTap(), protocol.Matched)
        return gather_facts(self.plan, self.phase, nodes, discovered, passed)

    def _wait_for_discovery(self) -> tuple[tuple[str, ...], protocol.Discovered]:
        """Return the result of discovery when it no longer changes; at first it is incomplete."""
        deadline = time.monotonic() + _MAX_DISCOVERY_S
        nodes, discovered = self._discover()
        while time.monotonic() < deadline:
            before = _endpoints(discovered)
            self.supervisor.pump(_DISCOVERY_INTERVAL_S)
            nodes, discovered = self._discover()
            if _endpoints(discovered) == before and self._knows_all_endpoints(discovered):
                break
        return nodes, discovered

    def _knows_all_endpoints(self, discovered: protocol.Discovered) -> bool:
        for node, topic, _, does in self.known:
            ends = discovered.writers if does == "publishes" else discovered.readers
            if topic not in NODE_TOPICS and all(end.node != node for end in ends.get(topic, ())):
                return False
        return all(
            discovered.writers.get(topic.name)
            for topic in self.plan.topics
            if topic.phase == self.phase and {"player", "loader"} & {*topic.writers}
        )

    def _discover(self) -> tuple[tuple[str, ...], protocol.Discovered]:
        """Return the nodes and the endpoints that discovery shows now."""
        graph = self.supervisor.ask_observer(protocol.ListGraph(), protocol.GraphSnapshot)
        planned = {topic.name for topic in self.plan.topics if topic.phase == self.phase}
        names = tuple(sorted({*planned, *graph.topics} - NODE_TOPICS))
        return graph.nodes, self.supervisor.ask_observer(
            protocol.Discover(topics=names), protocol.Discovered
        )


def wait_for_quiet(
    supervisor: ProcessSupervisor,
    files: Iterable[RowReader],
    quiet_s: float,
    limit_s: float,
) -> None:
    """Wait until no message has arrived for a while, at most `limit_s`: some topics never pause.

    Args:
        supervisor: the supervisor of all processes.
        files: the rows of a monitor.
        quiet_s: how long a while is, in seconds.
        limit_s: at most, in seconds.
    """
    files = [*files]
    last: list[int] = []
    changed = began = now = time.monotonic()
    while now - changed < quiet_s and now - began < limit_s:
        counts = [file.count() for file in files]
        if counts != last:
            last, changed = counts, now
        supervisor.pump(_POLL_S)
        now = time.monotonic()


def _endpoints(discovered: protocol.Discovered) -> list[tuple[str, str]]:
    """Return all endpoints, sorted."""
    both = (*discovered.writers.items(), *discovered.readers.items())
    return sorted((topic, repr(end)) for topic, ends in both for end in ends)


def guarded_topics(plan: Plan) -> tuple[str, ...]:
    """Return the played and recorded topics, on which only processes of the run may publish.

    There are none if nodes of others take part, or if a process loads another middleware than the
    observer, so that its publishers cannot be recognised.
    """
    if plan.external or any(RMW_VARIABLE in process.env for process in plan.processes):
        return ()
    topics = [source.topic for source in plan.inputs]
    topics += [monitor.topic for monitor in plan.topic_monitors]
    return tuple(dict.fromkeys(topics))


def foreign_publishers(supervisor: ProcessSupervisor) -> tuple[str, ...]:
    """Return in words every publisher seen on guarded topics that is not of this run."""
    seen = supervisor.ask_observer(protocol.ListForeign(), protocol.ForeignPublishers).publishers
    if not seen:
        return ()
    # The observer knows processes by their environment, which one may have lost or may hide.
    pids = supervisor.pids()
    is_own = middleware_of(os.environ).may_be_endpoint_of
    foreign = (
        _describe(publisher) for publisher in seen if not is_own(bytes.fromhex(publisher.gid), pids)
    )
    return tuple(dict.fromkeys(foreign))


def _describe(publisher: protocol.ForeignPublisher) -> str:
    who = " or ".join(publisher.processes) or "no process of this host"
    return (
        f"{publisher.topic}: node {publisher.node} "
        f"(GUID prefix {publisher.gid[:_PREFIX_DIGITS]}; {who})"
    )
