"""Which endpoints of a graph will never match, however long a run waits.

A missing endpoint alone proves nothing: its node may still load a model. It is certain that an
endpoint will not appear only if there is another one in its place: an endpoint that ROS does not
match because of its type or QoS, or one of the same type which nothing in the plan or in the graph
uses: on a similar or unmapped topic, or on any topic of the planned node in another namespace.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

from r2bspec.diagnostics import did_you_mean
from r2bspec.execute.diagnosis.find_fault import find_input_fault, first_fault
from r2bspec.execute.diagnosis.observe_graph import HARNESS, GraphFacts, TopicFacts
from r2bspec.wiring.name_resolution import SHARED_TOPICS


@dataclass(frozen=True)
class RemappedTopic:
    """A topic to which the plan remaps a name of a node.

    Attributes:
        node: the full name of the node in the plan.
        before: the name before remapping, as in the spec.
        topic: the full name after it.
        own_node_name: whether the running node has the name of the plan; other processes may have
            nodes of any name.
    """

    node: str
    before: str
    topic: str
    own_node_name: bool


def certain_topics(
    facts: GraphFacts, missing: Iterable[str], remapped: Iterable[RemappedTopic] = ()
) -> frozenset[str]:
    """The topics of `missing` whose endpoints will never match.

    Args:
        facts: of the graph; discovery is complete.
        missing: topics on which the harness, or a node, has fewer matches than planned.
        remapped: the remappings of the plan.
    """
    targets = {each.topic for each in unmatched(facts, remapped)}
    return frozenset(
        name
        for name in missing
        if _mismatch(facts, name) or any(_misplaced(facts, name, remapped=name in targets))
    )


def unmatched(facts: GraphFacts, remapped: Iterable[RemappedTopic]) -> Iterator[RemappedTopic]:
    """The remappings to topics on which their node has no endpoint."""
    planned = {
        node
        for topic in facts.topics.values()
        for node in (*topic.planned_publishers, *topic.planned_subscribers)
    }
    for each in remapped:
        topic = facts.topics.get(each.topic, TopicFacts(each.topic))
        nodes = {end.node for end in (*topic.publishers, *topic.subscriptions)} - {*HARNESS}
        own = {each.node} if each.own_node_name else nodes - (planned - {each.node})
        if not nodes & own:
            yield each


def _mismatch(facts: GraphFacts, name: str) -> bool:
    """Whether two endpoints of a topic exist that ROS does not match."""
    fault = find_input_fault(facts, name) if name in facts.inputs else first_fault(facts, name)
    return fault is not None and fault.topic == name and fault.kind in {"types", "qos"}


def _misplaced(facts: GraphFacts, name: str, *, remapped: bool) -> Iterator[str]:
    """The topics with an endpoint that was meant for a topic.

    Args:
        facts: of the graph.
        name: the topic that lacks an endpoint.
        remapped: whether a name is remapped to it, without effect.
    """
    topic = facts.topics.get(name, TopicFacts(name))
    as_publisher = not topic.publishers
    there = topic.subscriptions if as_publisher else topic.publishers
    types = {topic.type} - {""} or {each.type for each in there}
    owners = topic.planned_publishers if as_publisher else topic.planned_subscribers
    running = {*owners} - {*HARNESS} & facts.nodes
    for other in facts.topics.values():
        ends = other.publishers if as_publisher else other.subscriptions
        counterparts = other.subscriptions if as_publisher else other.publishers
        if other.name == name or counterparts or _is_planned(other):
            continue
        meant = [
            each
            for each in ends
            if each.node not in HARNESS
            and (not types or each.type in types)
            and (not running or each.node in running)
        ]
        moved = any(_is_moved(facts, each.node, owners) for each in meant)
        if meant and (_is_similar(name, other.name) or ((remapped or moved) and types)):
            yield other.name


def _is_moved(facts: GraphFacts, node: str, planned: Iterable[str]) -> bool:
    """Whether a node is a planned one in another namespace, where no node has the planned name."""
    return any(
        each not in facts.nodes and each.rpartition("/")[2] == node.rpartition("/")[2]
        for each in planned
    )


def _is_planned(topic: TopicFacts) -> bool:
    planned = topic.planned_publishers or topic.planned_subscribers
    return bool(planned) or topic.name in SHARED_TOPICS


def _is_similar(wanted: str, found: str) -> bool:
    """Whether two topics differ in their namespaces only, or by a typing error."""
    last = found.rpartition("/")[2]
    return bool(did_you_mean(wanted.rpartition("/")[2], [last]))
