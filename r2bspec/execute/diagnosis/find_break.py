"""The first break on the way of the messages: a decision on observed facts, and nothing else.

The way to a silent topic is every topic from which messages could come to it, by plan or in fact,
from the inputs on. The first of them decides on which something is wrong, looked at in this order:
nobody writes it; writer and reader differ in type, or in QoS; nothing passed; nobody who leads on
reads it.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Literal

from r2bspec.diagnostics import did_you_mean
from r2bspec.execute.diagnosis.graph_facts import HARNESS, GraphFacts, TopicFacts
from r2bspec.ipc.protocol import Endpoint

FaultKind = Literal["unwritten", "types", "qos", "swallowed", "unread"]

FAULT_CODES: dict[FaultKind, str] = {
    "unwritten": "R2B207",
    "unread": "R2B208",
    "types": "R2B210",
    "qos": "R2B216",
    "swallowed": "R2B641",
}
"""Where a rule of `validate` finds the same, its code."""


@dataclass(frozen=True)
class Fault:
    """Where the way ends: what is wrong with which topic, and whose end of it that is.

    `owner` is a node, or a part of the harness; empty if nobody is known.
    """

    kind: FaultKind
    topic: str
    owner: str
    sentence: str

    @property
    def code(self) -> str:
        """The code under which this is reported."""
        return FAULT_CODES[self.kind]


def path_to(facts: GraphFacts, silent: str) -> tuple[str, ...]:
    """The topics from the inputs to a silent one, in the order in which messages reach them."""
    behind = {silent}
    ahead = [silent]
    for topic in ahead:
        known = facts.topics.get(topic)
        for node in sorted(known.all_publishers - {*HARNESS}) if known else ():
            for read in facts.topics_subscribed_by(node):
                if read not in behind:
                    behind.add(read)
                    ahead.append(read)
    reached = [name for name in _reachable_topics(facts) if name in behind]
    rest = sorted(behind - {*reached, silent})
    return tuple(dict.fromkeys((*reached, *rest, silent)))


def full_path(facts: GraphFacts, silent: str) -> tuple[str, ...]:
    """The way to a silent topic; where none is known, all that the inputs lead to, as well."""
    path = path_to(facts, silent)
    if {*path} & {*facts.inputs}:
        return path
    return tuple(dict.fromkeys((*_reachable_topics(facts), *path)))


def _reachable_topics(facts: GraphFacts) -> list[str]:
    """The topics that messages can reach, in the order in which they do."""
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
    """The first break on the way to a silent topic; None if nothing is wrong that can be seen."""
    path = path_to(facts, silent)
    on_path = {*path}
    for name in path:
        topic = facts.topics.get(name, TopicFacts(name))
        found = _fault_at(facts, topic, silent=silent, on_path=on_path)
        if found is not None:
            return found
    return None


def find_input_fault(facts: GraphFacts, name: str) -> Fault | None:
    """What is wrong with the reading end of an input; None if nothing that can be seen."""
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
    if not topic.writers:
        return _no_publisher(facts, topic)
    wanted = sorted(_downstream_nodes(facts, topic, silent, on_path))
    found = _type_mismatch(topic, wanted) or _qos_mismatch(topic, wanted)
    if found is None and topic.passed == 0 and facts.played:
        found = _no_output(facts, topic)
    return found or _no_subscription(facts, topic, wanted)


def _downstream_nodes(
    facts: GraphFacts, topic: TopicFacts, silent: str, on_path: set[str]
) -> Iterator[str]:
    """Who must read a topic for messages to come further on the way."""
    for reader in topic.all_subscribers:
        if reader in HARNESS:
            if topic.name == silent:
                yield reader
        elif any(
            reader in facts.topics[name].all_publishers
            for name in on_path - {topic.name}
            if name in facts.topics
        ):
            yield reader


def _no_publisher(facts: GraphFacts, topic: TopicFacts) -> Fault:
    owner = next(iter(topic.planned_publishers), "")
    instead = facts.topics_published_by(owner) if owner else ()
    loose = [
        name
        for name, each in facts.topics.items()
        if each.writers and not each.readers and not each.planned_publishers
    ]
    close = _closest_name(topic.name, instead) or _closest_name(topic.name, loose)
    said = f"{topic.name}: nobody writes it"
    if close:
        by = _names(each.node for each in facts.topics[close].writers)
        said += f"; the nearest name is {close}, which {by} writes"
    elif instead:
        said += f"; {owner}, which should, writes {_names(instead)}"
    elif owner and facts.nodes and owner not in facts.nodes and owner not in HARNESS:
        said += f"; {owner}, which should, is not there"
    elif owner:
        said += f"; {owner}, which should, writes nothing"
    elif loose:
        by = _names(each.node for each in facts.topics[loose[0]].writers)
        said += f"; nobody reads {loose[0]}, which {by} writes"
    return Fault("unwritten", topic.name, owner, said)


def _type_mismatch(topic: TopicFacts, wanted: Iterable[str]) -> Fault | None:
    for writer in topic.writers:
        for reader in topic.readers:
            if reader.node in wanted and reader.type != writer.type:
                return Fault(
                    "types",
                    topic.name,
                    reader.node,
                    f"{topic.name}: {writer.node} writes {writer.type}, but {reader.node} reads "
                    f"{reader.type}; ROS never connects the two",
                )
        # A monitor does not even subscribe before it has seen a writer of its type.
        if topic.type and writer.type != topic.type and not _has_subscription(topic, wanted):
            return Fault(
                "types",
                topic.name,
                writer.node,
                f"{topic.name}: {writer.node} writes {writer.type}, where the spec says "
                f"{topic.type}",
            )
    return None


def _qos_mismatch(topic: TopicFacts, wanted: Iterable[str]) -> Fault | None:
    for pair in topic.qos_mismatches:
        if pair.reader in wanted:
            return Fault(
                "qos",
                topic.name,
                pair.reader,
                f"{topic.name}: what {pair.writer} offers is less than {pair.reader} asks for "
                f"({pair.why}); ROS never connects the two",
            )
    return None


def _no_output(facts: GraphFacts, topic: TopicFacts) -> Fault:
    writers = sorted({each.node for each in topic.writers})
    owner = writers[0]
    if topic.name in facts.inputs:
        said = f"{topic.name}: {_messages(facts.played)} were played, but none of them arrived"
        return Fault("swallowed", topic.name, owner, said)
    read = [facts.topics[name] for writer in writers for name in facts.topics_subscribed_by(writer)]
    supplied = [each for each in read if each.passed]
    starved = [each for each in read if not each.passed and each.name != topic.name]
    if supplied:
        first = supplied[0]
        how = "were played" if first.name in facts.inputs else "passed"
        said = f"{first.name}: {_messages(first.passed)} {how}, and {_names(writers)} reads it; "
        also = "".join(f", {_messages(each.passed)} on {each.name}" for each in supplied[1:])
        said += f"{_names(writers)} publishes nothing on {topic.name}" + (
            f", with {also[2:]} beside it" if also else ""
        )
    else:
        said = f"{topic.name}: {_names(writers)} publishes nothing on it"
    for each in starved[:1]:
        why = "nobody writes" if not each.writers else "has carried nothing"
        said += f"; it also reads {each.name}, which {why}"
    return Fault("swallowed", topic.name, owner, said)


def _no_subscription(facts: GraphFacts, topic: TopicFacts, wanted: list[str]) -> Fault | None:
    missing = [each for each in wanted if not _has_subscription(topic, [each])]
    if not missing and (wanted or _has_any_subscription(topic)):
        return None
    owner = missing[0] if missing else ""
    others = [
        name
        for name, each in facts.topics.items()
        if name != topic.name
        and any(not owner or owner in HARNESS or end.node == owner for end in each.readers)
    ]
    passed = ""
    if topic.passed:
        how = "were played" if topic.name in facts.inputs else "passed"
        passed = f"{_messages(topic.passed)} {how}, but "
    who = (
        f"{owner} does not read it" if owner and _has_any_subscription(topic) else "nobody reads it"
    )
    close = _closest_name(topic.name, [name for name in others if not facts.topics[name].writers])
    close = close or _closest_name(topic.name, others)
    said = f"{topic.name}: {passed}{who}"
    if close:
        by = _names(each.node for each in facts.topics[close].readers)
        said += f"; the nearest name is {close}, which {by} reads"
    elif owner and owner not in HARNESS:
        read = [name for name in others if any(e.node == owner for e in facts.topics[name].readers)]
        said += f"; {owner}, which should, reads {_names(read) or 'nothing'}"
    return Fault("unread", topic.name, owner, said)


def _closest_name(wrong: str, names: Iterable[str]) -> str:
    """The name that may have been meant, by what follows the namespace, which most have alike."""
    by_end = {name.rpartition("/")[2]: name for name in sorted(names, reverse=True)}
    close = did_you_mean(wrong.rpartition("/")[2], by_end)
    return by_end[close] if close else ""


def _has_subscription(topic: TopicFacts, nodes: Iterable[str]) -> bool:
    there = {each.node for each in topic.readers}
    return any(each in there for each in nodes)


def _has_any_subscription(topic: TopicFacts) -> bool:
    return any(each.node not in HARNESS for each in topic.readers)


def _names(names: Iterable[str]) -> str:
    return ", ".join(dict.fromkeys(names))


def _messages(count: int | None) -> str:
    return f"{count} message" if count == 1 else f"{count} messages"


def path_lines(facts: GraphFacts, path: Iterable[str]) -> list[str]:
    """The way in lines: who writes and who reads each topic, type, QoS, and how many passed."""
    lines = []
    for name in path:
        topic = facts.topics.get(name, TopicFacts(name))
        passed = "" if topic.passed is None else f"; {topic.passed} passed"
        lines.append(
            f"  {name} ({topic.type or 'type unknown'}): "
            f"writers: {_endpoint_texts(topic.writers, topic.type)}; "
            f"readers: {_endpoint_texts(topic.readers, topic.type)}{passed}"
        )
    return lines


def _endpoint_texts(ends: tuple[Endpoint, ...], usual: str) -> str:
    def one(end: Endpoint) -> str:
        said = [end.type] if end.type != usual else []
        said += [end.reliability]
        said += [end.durability] if end.durability != "volatile" else []
        return f"{end.node} ({', '.join(said)})"

    return ", ".join(one(end) for end in ends) or "none"
