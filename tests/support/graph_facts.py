"""Facts of graphs whose endpoints are as they are planned, unless it is said otherwise."""

from __future__ import annotations

from r2bspec.execute.diagnose.facts import GraphFacts, TopicFacts
from r2bspec.ipc.protocol import Endpoint, QosMismatch

IMAGE, TEXT = "sensor_msgs/msg/Image", "std_msgs/msg/String"


def end(node: str, kind: str = IMAGE) -> Endpoint:
    """An endpoint of a node."""
    return Endpoint(node=node, type=kind, reliability="reliable", durability="volatile")


def topic(
    name: str,
    publishers: str = "",
    subscriptions: str = "",
    *,
    planned: tuple[str, str] | None = None,
    passed: int | None = 10,
    kinds: tuple[str, str] = (IMAGE, IMAGE),
    qos_mismatches: tuple[QosMismatch, ...] = (),
) -> TopicFacts:
    """A topic with these endpoints; by default, the same ones are planned."""
    planned_publishers, planned_subscribers = planned or (publishers, subscriptions)
    return TopicFacts(
        name=name,
        type=IMAGE,
        planned_publishers=tuple(planned_publishers.split()),
        planned_subscribers=tuple(planned_subscribers.split()),
        publishers=tuple(end(node, kinds[0]) for node in publishers.split()),
        subscriptions=tuple(end(node, kinds[1]) for node in subscriptions.split()),
        qos_mismatches=qos_mismatches,
        passed=passed,
    )


def graph(*topics: TopicFacts, played: int | None = 10) -> GraphFacts:
    """A graph of the nodes /a, /b and /c."""
    return GraphFacts(
        topics={each.name: each for each in topics},
        inputs=tuple(each.name for each in topics if "player" in each.planned_publishers),
        played=played,
        nodes=frozenset({"/a", "/b", "/c"}),
    )
