"""The first fault on the path of the messages, from observed facts alone, and the report on it.

The path to a topic without messages consists of all topics from which messages can reach it,
planned or observed, starting at the inputs. On each topic the faults are checked in this order: it
has no publisher; publisher and subscription differ in type or in QoS; it has no messages; no
subscription leads further along the path.

A missing endpoint alone proves nothing: its node may still load a model. It is certain that an
endpoint will not appear only if there is another one in its place: an endpoint that ROS does not
match because of its type or QoS, or one of the same type which nothing in the plan or in the graph
uses: on a similar or unmapped topic, or on any topic of the planned node in another namespace.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator
from dataclasses import dataclass
from typing import Literal

from r2bspec.diagnostics import did_you_mean
from r2bspec.execute.bringup.observe_graph import HARNESS, GraphFacts, TopicFacts
from r2bspec.ipc.protocol import Endpoint
from r2bspec.wiring.name_resolution import SHARED_TOPICS

FaultKind = Literal["no publisher", "types", "qos", "no output", "no subscription"]

FAULT_CODES: dict[FaultKind, str] = {
    "no publisher": "R2B207",
    "no subscription": "R2B208",
    "types": "R2B210",
    "qos": "R2B216",
    "no output": "R2B641",
}
"""The code of the rule of `validate` that finds the same error, if there is one."""


@dataclass(frozen=True)
class Fault:
    """What is wrong on which topic, and with whose endpoint.

    `owner` is a node or a part of the harness; empty if unknown.
    """

    kind: FaultKind
    topic: str
    owner: str
    sentence: str

    @property
    def code(self) -> str:
        """The code of the error."""
        return FAULT_CODES[self.kind]


def path_to(facts: GraphFacts, silent: str) -> tuple[str, ...]:
    """The topics from the inputs to one without messages, in the order of the message flow."""
    upstream = {silent}
    pending = [silent]
    for topic in pending:
        known = facts.topics.get(topic)
        for node in sorted(known.all_publishers - {*HARNESS}) if known else ():
            for name in facts.topics_subscribed_by(node):
                if name not in upstream:
                    upstream.add(name)
                    pending.append(name)
    reached = [name for name in _reachable_topics(facts) if name in upstream]
    rest = sorted(upstream - {*reached, silent})
    return tuple(dict.fromkeys((*reached, *rest, silent)))


def full_path(facts: GraphFacts, silent: str) -> tuple[str, ...]:
    """The path to a topic without messages; if unknown, also all topics that inputs reach."""
    path = path_to(facts, silent)
    if {*path} & {*facts.inputs}:
        return path
    return tuple(dict.fromkeys((*_reachable_topics(facts), *path)))


def _reachable_topics(facts: GraphFacts) -> list[str]:
    """The topics that messages can reach, in the order of the message flow."""
    reached = sorted(facts.inputs)
    for topic in reached:
        nodes = facts.topics[topic].all_subscribers - {*HARNESS}
        reached += sorted(
            name
            for name, each in facts.topics.items()
            if name not in reached and nodes & each.all_publishers
        )
    return reached


def first_fault(facts: GraphFacts, silent: str) -> Fault | None:
    """The first fault on the path to a topic without messages; None if none is observed."""
    path = path_to(facts, silent)
    on_path = {*path}
    for name in path:
        topic = facts.topics.get(name, TopicFacts(name))
        found = _fault_at(facts, topic, silent=silent, on_path=on_path)
        if found is not None:
            return found
    return None


def find_input_fault(facts: GraphFacts, name: str) -> Fault | None:
    """The fault of the subscriptions of an input; None if none is observed."""
    topic = facts.topics.get(name, TopicFacts(name))
    wanted = sorted(topic.all_subscribers)
    return (
        _type_mismatch(topic, wanted)
        or _qos_mismatch(topic, wanted)
        or _no_subscription(facts, topic, wanted)
    )


def _fault_at(
    facts: GraphFacts, topic: TopicFacts, *, silent: str, on_path: set[str]
) -> Fault | None:
    if not topic.publishers:
        return _no_publisher(facts, topic)
    wanted = sorted(_downstream_nodes(facts, topic, silent, on_path))
    found = _type_mismatch(topic, wanted) or _qos_mismatch(topic, wanted)
    if found is None and topic.passed == 0 and facts.played:
        found = _no_output(facts, topic)
    return found or _no_subscription(facts, topic, wanted)


def _downstream_nodes(
    facts: GraphFacts, topic: TopicFacts, silent: str, on_path: set[str]
) -> Iterator[str]:
    """The nodes that must subscribe to a topic for messages to continue along the path."""
    for node in topic.all_subscribers:
        if node in HARNESS:
            if topic.name == silent:
                yield node
        elif any(
            node in facts.topics[name].all_publishers
            for name in on_path - {topic.name}
            if name in facts.topics
        ):
            yield node


def _no_publisher(facts: GraphFacts, topic: TopicFacts) -> Fault:
    owner = next(iter(topic.planned_publishers), "")
    instead = facts.topics_published_by(owner) if owner else ()
    unused = [
        name
        for name, each in facts.topics.items()
        if each.publishers and not each.subscriptions and not each.planned_publishers
    ]
    close = _closest_name(topic.name, instead) or _closest_name(topic.name, unused)
    sentence = f"no publisher on {topic.name}"
    if topic.all_subscribers:
        subscribers = sorted(topic.all_subscribers)
        sentence += f", to which {_names(subscribers)} {_verb('subscribe', subscribers)}"
    if close:
        by = _names(each.node for each in facts.topics[close].publishers)
        sentence += f"; the closest name is {close}, published by {by}"
    elif instead:
        sentence += f"; its planned publisher {owner} publishes on {_names(instead)}"
    elif owner and facts.nodes and owner not in facts.nodes and owner not in HARNESS:
        sentence += f"; its planned publisher {owner} is not running"
    elif owner:
        sentence += f"; its planned publisher {owner} publishes nothing"
    elif unused:
        by = _names(each.node for each in facts.topics[unused[0]].publishers)
        sentence += f"; {unused[0]}, published by {by}, has no subscription"
    return Fault("no publisher", topic.name, owner, sentence)


def _type_mismatch(topic: TopicFacts, wanted: Iterable[str]) -> Fault | None:
    for publisher in topic.publishers:
        for subscription in topic.subscriptions:
            if subscription.node in wanted and subscription.type != publisher.type:
                return Fault(
                    "types",
                    topic.name,
                    subscription.node,
                    f"{subscription.node} subscribes to {topic.name} as {subscription.type}, but "
                    f"{publisher.node} publishes {topic.name} as {publisher.type}; ROS does not "
                    "match them",
                )
        # A monitor subscribes only after it has discovered a publisher of its type.
        if topic.type and publisher.type != topic.type and not _has_subscription(topic, wanted):
            return Fault(
                "types",
                topic.name,
                publisher.node,
                f"{publisher.node} publishes {topic.name} as {publisher.type}, but its type in the "
                f"spec is {topic.type}",
            )
    return None


def _qos_mismatch(topic: TopicFacts, wanted: Iterable[str]) -> Fault | None:
    for pair in topic.qos_mismatches:
        if pair.reader in wanted:
            return Fault(
                "qos",
                topic.name,
                pair.reader,
                f"{pair.reader} requests a QoS on {topic.name} that {pair.writer} does not offer "
                f"({pair.why}); ROS does not match them",
            )
    return None


def _no_output(facts: GraphFacts, topic: TopicFacts) -> Fault:
    publishers = sorted({each.node for each in topic.publishers})
    owner = publishers[0]
    if topic.name in facts.inputs:
        sentence = f"{_messages(facts.played)} were played on {topic.name}, but none arrived"
        return Fault("no output", topic.name, owner, sentence)
    subscribed = [
        facts.topics[name] for node in publishers for name in facts.topics_subscribed_by(node)
    ]
    supplied = [each for each in subscribed if each.passed]
    starved = [each for each in subscribed if not each.passed and each.name != topic.name]
    subscribes = _verb("subscribe", publishers)
    it = "it" if len(publishers) == 1 else "they"
    sentence = f"{_names(publishers)} {_verb('publish', publishers)} nothing on {topic.name}"
    if supplied:
        counts = " and ".join(f"{each.name} ({_messages(each.passed)})" for each in supplied)
        sentence += f", although {it} {subscribes} to {counts}"
    for each in starved[:1]:
        state = "no messages" if each.publishers else "no publisher"
        sentence += f"; {it} also {subscribes} to {each.name}, which has {state}"
    return Fault("no output", topic.name, owner, sentence)


def _no_subscription(facts: GraphFacts, topic: TopicFacts, wanted: list[str]) -> Fault | None:
    missing = [each for each in wanted if not _has_subscription(topic, [each])]
    if not missing and (wanted or _has_any_subscription(topic)):
        return None
    owner = missing[0] if missing else ""
    others = [
        name
        for name, each in facts.topics.items()
        if name != topic.name
        and any(not owner or owner in HARNESS or end.node == owner for end in each.subscriptions)
    ]
    sentence = (
        f"{owner} does not subscribe to {topic.name}"
        if owner and _has_any_subscription(topic)
        else f"no subscription to {topic.name}"
    )
    if topic.passed:
        verb = "were played" if topic.name in facts.inputs else "were published"
        sentence += f", on which {_messages(topic.passed)} {verb}"
    elif topic.name in facts.inputs:
        sentence += ", which is played"
    close = _closest_name(
        topic.name, [name for name in others if not facts.topics[name].publishers]
    ) or _closest_name(topic.name, others)
    if close:
        by = [each.node for each in facts.topics[close].subscriptions]
        sentence += f"; the closest name is {close}, to which {_names(by)} {_verb('subscribe', by)}"
    elif owner and owner not in HARNESS:
        subscribed = [
            name
            for name in others
            if any(end.node == owner for end in facts.topics[name].subscriptions)
        ]
        sentence += f"; its planned subscriber {owner} " + (
            f"subscribes to {_names(subscribed)}" if subscribed else "has no subscriptions"
        )
    elif unused := [name for name in others if _is_unused(facts.topics[name])]:
        by = [each.node for each in facts.topics[unused[0]].subscriptions]
        sentence += (
            f"; {unused[0]}, to which {_names(by)} {_verb('subscribe', by)}, has no publisher"
        )
    return Fault("no subscription", topic.name, owner, sentence)


def _closest_name(wrong: str, names: Iterable[str]) -> str:
    """The closest name, compared without the namespaces, which most topics share."""
    by_end = {name.rpartition("/")[2]: name for name in sorted(names, reverse=True)}
    close = did_you_mean(wrong.rpartition("/")[2], by_end)
    return by_end[close] if close else ""


def _has_subscription(topic: TopicFacts, nodes: Iterable[str]) -> bool:
    subscribers = {each.node for each in topic.subscriptions}
    return any(each in subscribers for each in nodes)


def _is_unused(topic: TopicFacts) -> bool:
    """Whether a topic that is not in the plan has subscriptions, and nothing publishes it."""
    return not (topic.publishers or topic.planned_publishers or topic.planned_subscribers)


def _has_any_subscription(topic: TopicFacts) -> bool:
    return any(each.node not in HARNESS for each in topic.subscriptions)


def _names(names: Iterable[str]) -> str:
    return " and ".join(dict.fromkeys(names))


def _verb(verb: str, subjects: Iterable[str]) -> str:
    """The form of a verb, such as "publish", for one or several subjects."""
    if len({*subjects}) > 1:
        return verb
    return f"{verb}es" if verb.endswith("sh") else f"{verb}s"


def _messages(count: int | None) -> str:
    return f"{count} message" if count == 1 else f"{count} messages"


def path_lines(facts: GraphFacts, path: Iterable[str]) -> list[str]:
    """The path as lines: publishers, subscriptions, types, QoS and message count of each topic."""
    lines = []
    for name in path:
        topic = facts.topics.get(name, TopicFacts(name))
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
) -> tuple[Fault, ...]:
    """The first fault on the path to each topic without messages, and those of some inputs.

    Each topic is reported once.
    """
    faults_of_silent = [first_fault(facts, each) for each in silent]
    found = [*(find_input_fault(facts, each) for each in inputs), *faults_of_silent]
    return tuple({each.topic: each for each in found if each is not None}.values())


@dataclass(frozen=True)
class FaultReport:
    """What is wrong with a graph, in words.

    Attributes:
        sentences: one for each fault.
        also: other differences of the nodes with faults; may be empty.
        path: a line for each topic on the way of the messages.
    """

    sentences: tuple[str, ...]
    also: str
    path: tuple[str, ...]

    def text(self, state: str, said: Collection[str] = ()) -> str:
        """The report as a text that begins with the state of the graph.

        Args:
            state: such as ``no messages on /out``.
            said: sentences that the reader knows.
        """
        left = "; ".join(each for each in self.sentences if each not in said) + self.also
        head = f"{state}: {left.removeprefix('; ')}" if left else state
        return "\n".join([head, *self.path])


def fault_report(
    facts: GraphFacts, silent: Iterable[str], faults: Iterable[Fault], also: str = ""
) -> FaultReport:
    """The sentences of the faults, then `also`, and below them the complete path."""
    path = dict.fromkeys(name for each in silent for name in full_path(facts, each))
    sentences = [each.sentence for each in faults]
    if not sentences:
        sentences = ["publishers and subscriptions are matched, and no fault was found"]
    return FaultReport(tuple(sentences), also, tuple(path_lines(facts, path)))


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
