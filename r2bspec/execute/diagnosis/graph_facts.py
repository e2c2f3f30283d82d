"""The facts about a graph without output: planned and discovered endpoints, counted messages."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property

from r2bspec.ipc.protocol import Endpoint, QosMismatch
from r2bspec.plan.plan import Plan

HARNESS = ("loader", "player", "monitor")
"""The names of the parts of the harness in plans; every other name is the full name of a node."""


@dataclass(frozen=True)
class TopicFacts:
    """One topic.

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

    @cached_property
    def all_publishers(self) -> frozenset[str]:
        """The nodes that publish it, planned or discovered."""
        return frozenset(self.planned_publishers) | {each.node for each in self.publishers}

    @cached_property
    def all_subscribers(self) -> frozenset[str]:
        """The nodes that subscribe to it, planned or discovered."""
        return frozenset(self.planned_subscribers) | {each.node for each in self.subscriptions}


@dataclass(frozen=True)
class GraphFacts:
    """A graph.

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

    def topics_subscribed_by(self, node: str) -> tuple[str, ...]:
        """The topics to which a node subscribes, planned or discovered, sorted."""
        return tuple(sorted(n for n, each in self.topics.items() if node in each.all_subscribers))

    def topics_published_by(self, node: str) -> tuple[str, ...]:
        """The topics on which a node has a publisher, sorted."""
        return tuple(
            sorted(
                n for n, t in self.topics.items() if any(each.node == node for each in t.publishers)
            )
        )


def topics_of(facts: GraphFacts, node: str) -> tuple[str, ...]:
    """The topics of a running node; if it is not found, those of nodes that are not in the plan."""
    planned = {
        each
        for topic in facts.topics.values()
        for each in (*topic.planned_publishers, *topic.planned_subscribers)
    }
    by_node: dict[str, list[str]] = {}
    for name, topic in sorted(facts.topics.items()):
        for end in (*topic.publishers, *topic.subscriptions):
            if end.node not in HARNESS:
                by_node.setdefault(end.node, []).append(name)
    if node in by_node:
        return tuple(dict.fromkeys(by_node[node]))
    found = (name for each, names in by_node.items() if each not in planned for name in names)
    return tuple(dict.fromkeys(found))


def gather_facts(
    plan: Plan,
    phase: str,
    discovered: Mapping[str, tuple[tuple[Endpoint, ...], tuple[Endpoint, ...]]],
    qos_mismatches: Iterable[QosMismatch] = (),
    *,
    nodes: Iterable[str] = (),
    passed: Mapping[str, int] | None = None,
    played: int | None = None,
) -> GraphFacts:
    """Combine the plan with the observations.

    Args:
        plan: of the run.
        phase: ``preprocess`` or ``measure``.
        discovered: publishers and subscriptions of each topic.
        qos_mismatches: pairs that never match.
        nodes: the discovered nodes.
        passed: messages counted, by topic.
        played: steps that were played in that time.
    """
    planned = {each.name: each for each in plan.topics if each.phase == phase}
    mismatches = [*qos_mismatches]
    topics = {}
    for name in sorted({*planned, *discovered}):
        plan_topic = planned.get(name)
        publishers, subscriptions = discovered.get(name, ((), ()))
        expected_subscribers = plan_topic.readers if plan_topic else ()
        topics[name] = TopicFacts(
            name=name,
            type=plan_topic.type if plan_topic else "",
            planned_publishers=plan_topic.writers if plan_topic else (),
            planned_subscribers=expected_subscribers,
            publishers=tuple(_with_plan_name(each) for each in publishers),
            subscriptions=tuple(
                found
                for each in subscriptions
                if (found := _with_plan_name(each)).node not in HARNESS
                or found.node in expected_subscribers
            ),
            qos_mismatches=tuple(
                QosMismatch(_name(each.writer), _name(each.reader), each.topic, each.why)
                for each in mismatches
                if each.topic == name
            ),
            passed=None if passed is None else passed.get(name),
        )
    begin = "loader" if phase == "preprocess" else "player"
    inputs = tuple(name for name, each in topics.items() if begin in each.planned_publishers)
    return GraphFacts(topics=topics, inputs=inputs, played=played, nodes=frozenset(nodes))


def _name(node: str) -> str:
    """The name of a node in the plan: of a part of the harness its role."""
    role = node.removeprefix("/r2bspec/")
    return role if role in HARNESS else node


def _with_plan_name(end: Endpoint) -> Endpoint:
    return Endpoint(
        node=_name(end.node),
        type=end.type,
        reliability=end.reliability,
        durability=end.durability,
    )
