"""The first fault on the path of the messages, from observed facts alone, in words.

The path to a topic without messages consists of all topics from which messages can reach it,
planned or observed, starting at the inputs. On each topic the faults are checked in this order: it
has no publisher; publisher and subscription differ in type or in QoS; it has no messages; no
subscription leads further along the path.

A missing endpoint alone proves nothing: its node may still load a model. Endpoints that ROS does
not match because of their types or QoS never will be.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator
from typing import TYPE_CHECKING, Any, Final

from r2bspec.diagnostics import did_you_mean
from r2bspec.execute.bringup.node_faults import RemappedTopic
from r2bspec.execute.diagnose.facts import GraphFacts, TopicFacts
from r2bspec.ipc.protocol import Endpoint
from r2bspec.plan.plan import HARNESS_PARTS
from r2bspec.record.run_record import Difference

if TYPE_CHECKING:
    import networkx

NO_PUBLISHER: Final = "R2B207"
NO_SUBSCRIPTION: Final = "R2B208"
TYPES_DIFFER: Final = "R2B210"
QOS_DIFFERS: Final = "R2B216"
NO_OUTPUT: Final = "R2B641"
"""The codes of faults; all but the last are those of the rules of `validate` that find the same."""

NEVER_MATCHED: Final = frozenset({TYPES_DIFFER, QOS_DIFFERS})
"""Faults of two endpoints that are there."""


def _fault(code: str, topic: str, owner: str, message: str, instead: str = "") -> Difference:
    """Return what is wrong on a topic.

    `owner` is a node or a part of the harness; empty if unknown. `instead` is the topic that has an
    endpoint which was probably meant for this one; empty without one.
    """
    return Difference(
        code=code, message=message, part="endpoint", owner=owner, name=topic, topic=instead
    )


def path_to(facts: GraphFacts, silent: str) -> tuple[str, ...]:
    """Return the topics from the inputs to a topic without messages, in the order of the flow."""
    import networkx

    flow = _flow(facts)
    flow.add_node(silent)
    upstream = {each for each in networkx.ancestors(flow, silent) if isinstance(each, str)}
    reached = [name for name in _reached(flow, facts) if name in {*upstream, silent}]
    return tuple(dict.fromkeys((*reached, *sorted(upstream), silent)))


def full_path(facts: GraphFacts, silent: str) -> tuple[str, ...]:
    """Return the path to a topic without messages.

    If the path is unknown, all topics that the inputs reach are added.
    """
    path = path_to(facts, silent)
    if {*path} & {*facts.inputs}:
        return path
    return tuple(dict.fromkeys((*_reached(_flow(facts), facts), *path)))


def _flow(facts: GraphFacts) -> networkx.DiGraph[Any]:
    """Return topics and nodes, planned or discovered; a node is in a tuple of its own."""
    import networkx

    flow: networkx.DiGraph[Any] = networkx.DiGraph()
    for name, topic in facts.topics.items():
        flow.add_node(name)
        flow.add_edges_from(((node,), name) for node in topic.all_publishers - {*HARNESS_PARTS})
        flow.add_edges_from((name, (node,)) for node in topic.all_subscribers - {*HARNESS_PARTS})
    return flow


def _reached(flow: networkx.DiGraph[Any], facts: GraphFacts) -> Iterator[str]:
    """Yield the topics that messages of the inputs can reach, in the order of the flow."""
    import networkx

    for layer in networkx.bfs_layers(flow, facts.inputs):
        yield from sorted(each for each in layer if isinstance(each, str))


def first_fault(facts: GraphFacts, silent: str) -> Difference | None:
    """Return the first fault on the path to a topic without messages; None if none is observed."""
    path = path_to(facts, silent)
    faults = (_fault_at(facts, facts.topic(name), silent, path) for name in path)
    return next((fault for fault in faults if fault is not None), None)


def find_input_fault(facts: GraphFacts, name: str) -> Difference | None:
    """Return the fault of the subscriptions of an input; None if none is observed."""
    topic = facts.topic(name)
    readers = sorted(topic.all_subscribers)
    return _mismatch(topic, readers) or _no_subscription(facts, topic, readers)


def _fault_at(
    facts: GraphFacts, topic: TopicFacts, silent: str, path: Iterable[str]
) -> Difference | None:
    if not topic.publishers:
        return _no_publisher(facts, topic)
    # The nodes that must subscribe to it for messages to continue along the path.
    onward = {
        node for name in path if name != topic.name for node in facts.topic(name).all_publishers
    }
    readers = sorted(
        node
        for node in topic.all_subscribers
        if (topic.name == silent if node in HARNESS_PARTS else node in onward)
    )
    fault = _mismatch(topic, readers)
    if fault is None and topic.passed == 0 and facts.played:
        fault = _no_output(facts, topic)
    return fault or _no_subscription(facts, topic, readers)


def _mismatch(topic: TopicFacts, readers: Collection[str]) -> Difference | None:
    """Two endpoints that ROS does not match, because of their types or their QoS."""
    return _type_mismatch(topic, readers) or _qos_mismatch(topic, readers)


def _no_publisher(facts: GraphFacts, topic: TopicFacts) -> Difference:
    owner = next(iter(topic.planned_publishers), "")
    instead = facts.topics_published_by(owner) if owner else ()
    unused = [
        name
        for name, other in facts.topics.items()
        if other.publishers and not other.subscriptions and not other.planned_publishers
    ]
    close = _closest_name(topic.name, instead) or _closest_name(topic.name, unused)
    sentence = f"no publisher on {topic.name}"
    if subscribers := sorted(topic.all_subscribers):
        sentence += f", to which {_who(subscribers, 'subscribe')}"
    if close:
        by = _names(facts.topics[close].publisher_nodes)
        sentence += f"; the closest name is {close}, published by {by}"
    elif instead:
        sentence += f"; its planned publisher {owner} publishes on {_names(instead)}"
    elif owner and facts.nodes and owner not in facts.nodes and owner not in HARNESS_PARTS:
        sentence += f"; its planned publisher {owner} is not running"
    elif owner:
        sentence += f"; its planned publisher {owner} publishes nothing"
    elif unused:
        by = _names(facts.topics[unused[0]].publisher_nodes)
        sentence += f"; {unused[0]}, published by {by}, has no subscription"
    return _fault(NO_PUBLISHER, topic.name, owner, sentence, close)


def _type_mismatch(topic: TopicFacts, readers: Collection[str]) -> Difference | None:
    for publisher in topic.publishers:
        for subscription in topic.subscriptions:
            if subscription.node in readers and subscription.type != publisher.type:
                return _fault(
                    TYPES_DIFFER,
                    topic.name,
                    subscription.node,
                    f"{subscription.node} subscribes to {topic.name} as {subscription.type}, but "
                    f"{publisher.node} publishes {topic.name} as {publisher.type}; ROS does not "
                    "match them",
                )
        # A monitor subscribes only after it has discovered a publisher of its type.
        reads = any(node in readers for node in topic.subscriber_nodes)
        if topic.type and publisher.type != topic.type and not reads:
            return _fault(
                TYPES_DIFFER,
                topic.name,
                publisher.node,
                f"{publisher.node} publishes {topic.name} as {publisher.type}, but its type in the "
                f"spec is {topic.type}",
            )
    return None


def _qos_mismatch(topic: TopicFacts, readers: Collection[str]) -> Difference | None:
    for pair in topic.qos_mismatches:
        if pair.reader in readers:
            return _fault(
                QOS_DIFFERS,
                topic.name,
                pair.reader,
                f"{pair.reader} requests a QoS on {topic.name} that {pair.writer} does not offer "
                f"({pair.why}); ROS does not match them",
            )
    return None


def _no_output(facts: GraphFacts, topic: TopicFacts) -> Difference:
    publishers = sorted(topic.publisher_nodes)
    owner = publishers[0]
    if topic.name in facts.inputs:
        sentence = f"{_messages(facts.played)} were played on {topic.name}, but none arrived"
        return _fault(NO_OUTPUT, topic.name, owner, sentence)
    subscribed = [
        facts.topics[name] for node in publishers for name in facts.topics_subscribed_by(node)
    ]
    supplied = [other for other in subscribed if other.passed]
    starved = [other for other in subscribed if not other.passed and other.name != topic.name]
    it, subscribes = ("it", "subscribes") if len(publishers) == 1 else ("they", "subscribe")
    sentence = f"{_who(publishers, 'publish')} nothing on {topic.name}"
    if supplied:
        counts = " and ".join(f"{other.name} ({_messages(other.passed)})" for other in supplied)
        sentence += f", although {it} {subscribes} to {counts}"
    if starved:
        state = "no messages" if starved[0].publishers else "no publisher"
        sentence += f"; {it} also {subscribes} to {starved[0].name}, which has {state}"
    return _fault(NO_OUTPUT, topic.name, owner, sentence)


def _no_subscription(facts: GraphFacts, topic: TopicFacts, readers: list[str]) -> Difference | None:
    missing = [node for node in readers if node not in topic.subscriber_nodes]
    has_any = not {*topic.subscriber_nodes} <= {*HARNESS_PARTS}
    if not missing and (readers or has_any):
        return None
    owner = missing[0] if missing else ""
    is_node = bool(owner) and owner not in HARNESS_PARTS
    others = {
        name: other
        for name, other in facts.topics.items()
        if name != topic.name
        and (owner in other.subscriber_nodes if is_node else other.subscriptions)
    }
    sentence = (
        f"{owner} does not subscribe to {topic.name}"
        if owner and has_any
        else f"no subscription to {topic.name}"
    )
    if topic.passed:
        verb = "were played" if topic.name in facts.inputs else "were published"
        sentence += f", on which {_messages(topic.passed)} {verb}"
    elif topic.name in facts.inputs:
        sentence += ", which is played"
    unpublished = [name for name, other in others.items() if not other.publishers]
    close = _closest_name(topic.name, unpublished) or _closest_name(topic.name, others)
    unused = [name for name in unpublished if not others[name].is_planned]
    if close:
        who = _who(others[close].subscriber_nodes, "subscribe")
        sentence += f"; the closest name is {close}, to which {who}"
    elif is_node:
        subscribed = f"subscribes to {_names(others)}" if others else "has no subscriptions"
        sentence += f"; its planned subscriber {owner} {subscribed}"
    elif unused:
        who = _who(others[unused[0]].subscriber_nodes, "subscribe")
        sentence += f"; {unused[0]}, to which {who}, has no publisher"
    return _fault(NO_SUBSCRIPTION, topic.name, owner, sentence, close)


def _closest_name(wrong: str, names: Iterable[str]) -> str:
    """Return the closest name, compared without the namespaces, which most topics share."""
    by_end = {name.rpartition("/")[2]: name for name in sorted(names, reverse=True)}
    close = did_you_mean(wrong.rpartition("/")[2], by_end)
    return by_end[close] if close else ""


def _names(names: Iterable[str]) -> str:
    return " and ".join(dict.fromkeys(names))


def _who(subjects: Collection[str], verb: str) -> str:
    """Return the subjects and their verb, such as "publish" or "publishes"."""
    several = len({*subjects}) > 1
    ending = "" if several else "es" if verb.endswith("sh") else "s"
    return f"{_names(subjects)} {verb}{ending}"


def _messages(count: int | None) -> str:
    return f"{count} message" if count == 1 else f"{count} messages"


def path_lines(facts: GraphFacts, path: Iterable[str]) -> list[str]:
    """Return the lines of a path: publishers, subscriptions, types, QoS and message counts."""
    lines = []
    for name in path:
        topic = facts.topic(name)
        passed = "" if topic.passed is None else f"; {_messages(topic.passed)}"
        lines.append(
            f"  {name} ({topic.type or 'type unknown'}): "
            f"publishers: {_endpoint_texts(topic.publishers, topic.type)}; "
            f"subscriptions: {_endpoint_texts(topic.subscriptions, topic.type)}{passed}"
        )
    return lines


def _endpoint_texts(ends: tuple[Endpoint, ...], planned_type: str) -> str:
    def one(end: Endpoint) -> str:
        words = [end.type] if end.type != planned_type else []
        words += [end.reliability]
        words += [end.durability] if end.durability != "volatile" else []
        return f"{end.node} ({', '.join(words)})"

    return ", ".join(one(end) for end in ends) or "none"


def find_faults(
    facts: GraphFacts, silent: Iterable[str], inputs: Iterable[str] = ()
) -> tuple[Difference, ...]:
    """Return the first fault on the path to each topic without messages, and those of some inputs.

    Each topic is reported once.
    """
    faults = [find_input_fault(facts, name) for name in inputs]
    faults += [first_fault(facts, name) for name in silent]
    return tuple({fault.name: fault for fault in faults if fault is not None}.values())


def unmatched(facts: GraphFacts, remapped: Iterable[RemappedTopic]) -> Iterator[RemappedTopic]:
    """Yield the remappings to topics on which their node has no endpoint."""
    for rule in remapped:
        topic = facts.topic(rule.topic)
        nodes = {*topic.publisher_nodes, *topic.subscriber_nodes} - {*HARNESS_PARTS}
        own = {rule.node} if rule.own_node_name else nodes - (facts.planned_nodes - {rule.node})
        if not nodes & own:
            yield rule
