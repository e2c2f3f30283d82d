"""What is known of a graph when something does not arrive: planned, discovered, and counted."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property

from r2bspec.ipc.protocol import Endpoint, QosMismatch
from r2bspec.plan.plan import Plan

HARNESS = ("loader", "player", "monitor")
"""How plans call the ends of a way; everything else is the full name of a node."""


@dataclass(frozen=True)
class TopicFacts:
    """One topic.

    Attributes:
        name: full name.
        type: as planned; empty if the plan does not know it, or not the topic.
        planned_publishers: nodes or parts of the harness.
        planned_subscribers: likewise.
        writers: what discovery shows, parts of the harness by the names that plans use.
        readers: likewise; without whoever only looks.
        qos_mismatches: pairs that never connect, because the one offers less than the other asks
            for.
        passed: messages that were seen on it while some were played; None if nobody could look.
    """

    name: str
    type: str = ""
    planned_publishers: tuple[str, ...] = ()
    planned_subscribers: tuple[str, ...] = ()
    writers: tuple[Endpoint, ...] = ()
    readers: tuple[Endpoint, ...] = ()
    qos_mismatches: tuple[QosMismatch, ...] = ()
    passed: int | None = None

    @cached_property
    def all_publishers(self) -> frozenset[str]:
        """Whoever writes it, by plan or in fact."""
        return frozenset(self.planned_publishers) | {each.node for each in self.writers}

    @cached_property
    def all_subscribers(self) -> frozenset[str]:
        """Whoever reads it, by plan or in fact."""
        return frozenset(self.planned_subscribers) | {each.node for each in self.readers}


@dataclass(frozen=True)
class GraphFacts:
    """A graph.

    Attributes:
        topics: every topic, planned or seen, by name.
        inputs: what the player or the loader publishes.
        played: steps that were played while somebody looked; None if none were.
        nodes: the full names of the nodes that are there.
    """

    topics: Mapping[str, TopicFacts]
    inputs: tuple[str, ...]
    played: int | None = None
    nodes: frozenset[str] = frozenset()

    def topics_subscribed_by(self, node: str) -> tuple[str, ...]:
        """The topics that a node reads, by plan or in fact, sorted."""
        return tuple(sorted(n for n, each in self.topics.items() if node in each.all_subscribers))

    def topics_published_by(self, node: str) -> tuple[str, ...]:
        """The topics that a node writes in fact, sorted."""
        return tuple(
            sorted(
                n for n, t in self.topics.items() if any(each.node == node for each in t.writers)
            )
        )


def gather_facts(
    plan: Plan,
    phase: str,
    seen: Mapping[str, tuple[tuple[Endpoint, ...], tuple[Endpoint, ...]]],
    qos_mismatches: Iterable[QosMismatch] = (),
    *,
    nodes: Iterable[str] = (),
    passed: Mapping[str, int] | None = None,
    played: int | None = None,
) -> GraphFacts:
    """Put together what was planned and what was seen.

    Args:
        plan: of the run.
        phase: ``preprocess`` or ``measure``.
        seen: topic to its writers and readers, as discovery shows them.
        qos_mismatches: pairs that never connect.
        nodes: the nodes that are there.
        passed: messages counted, by topic.
        played: steps that were played meanwhile.
    """
    planned = {each.name: each for each in plan.topics if each.phase == phase}
    refusals = [*qos_mismatches]
    topics = {}
    for name in sorted({*planned, *seen}):
        plan_topic = planned.get(name)
        writers, readers = seen.get(name, ((), ()))
        expected_subscribers = plan_topic.readers if plan_topic else ()
        topics[name] = TopicFacts(
            name=name,
            type=plan_topic.type if plan_topic else "",
            planned_publishers=plan_topic.writers if plan_topic else (),
            planned_subscribers=expected_subscribers,
            writers=tuple(_plain(each) for each in writers),
            readers=tuple(
                found
                for each in readers
                if (found := _plain(each)).node not in HARNESS or found.node in expected_subscribers
            ),
            qos_mismatches=tuple(
                QosMismatch(_name(each.writer), _name(each.reader), each.topic, each.why)
                for each in refusals
                if each.topic == name
            ),
            passed=None if passed is None else passed.get(name),
        )
    begin = "loader" if phase == "preprocess" else "player"
    inputs = tuple(name for name, each in topics.items() if begin in each.planned_publishers)
    return GraphFacts(topics=topics, inputs=inputs, played=played, nodes=frozenset(nodes))


def _name(node: str) -> str:
    """A node as the plan calls it: parts of the harness by their role alone."""
    role = node.removeprefix("/r2bspec/")
    return role if role in HARNESS else node


def _plain(end: Endpoint) -> Endpoint:
    return Endpoint(
        node=_name(end.node),
        type=end.type,
        reliability=end.reliability,
        durability=end.durability,
    )
