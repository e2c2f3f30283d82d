"""Subscribed topics without a publisher."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

from r2bspec.check.certainty import with_record
from r2bspec.check.rule_api import (
    MAX_SUGGESTIONS,
    Context,
    Endpoint,
    Finding,
    Findings,
    NodeWiring,
    PhaseWiring,
    Pointer,
    Rule,
    did_you_mean,
    flow_key,
    quote,
    quoted_list,
    topic_key,
    value_key,
)
from r2bspec.wiring.name_resolution import SHARED_TOPICS
from r2bspec.wiring.node_interface import InterfaceSource


def _find(context: Context) -> Findings:
    found = 0
    for phase in context.wiring.phases:
        published = tuple(name for name in phase.topics if phase.publishers(name))
        for subscription in phase.endpoints:
            if subscription.topic in SHARED_TOPICS and subscription.is_node:
                continue
            # The recorder subscribes to the 'from' of playback inputs: see R2B401.
            if (
                not subscription.is_publisher
                and subscription.owner != "recorder"
                and not phase.publishers(subscription.topic)
            ):
                found += 1
                names = published if found <= MAX_SUGGESTIONS else ()
                unpublished = _UnpublishedTopic(context, phase, subscription, names)
                yield with_record(context, _finding(unpublished), *_sources(unpublished))


@dataclass(frozen=True)
class _UnpublishedTopic:
    """A subscription without a publisher, and the published topics that may have been meant."""

    context: Context
    phase: PhaseWiring
    subscription: Endpoint
    published: tuple[str, ...]

    @cached_property
    def node(self) -> NodeWiring | None:
        """The node that subscribes; None for a monitor."""
        return self.phase.node(self.subscription.owner)

    @cached_property
    def topic_name(self) -> str:
        """The topic, relative to the namespace of the node."""
        return self.relative_name(self.subscription.topic)

    def relative_name(self, topic: str) -> str:
        """Any topic, relative to the namespace of the node."""
        return self.context.relative_name(topic, self.node.namespace if self.node else "")

    @cached_property
    def candidates(self) -> dict[str, str]:
        """Full names of the published topics, by their relative names."""
        return {self.relative_name(name): name for name in self.published if not self._is_own(name)}

    def _is_own(self, topic: str) -> bool:
        return any(
            publisher.owner == self.subscription.owner for publisher in self.phase.publishers(topic)
        )

    @cached_property
    def close(self) -> str:
        """The full name of the published topic with the closest name; empty if none is close."""
        return self.candidates.get(did_you_mean(self.topic_name, self.candidates), "")

    def type_matches(self, topic: str) -> bool:
        """Whether a topic has the type of the subscription, or an unknown one."""
        return any(
            each.type in {self.subscription.type, ""} for each in self.phase.publishers(topic)
        )


def _finding(unpublished: _UnpublishedTopic) -> Finding:
    phase, subscription = unpublished.phase, unpublished.subscription
    unknown = [node.key for node in phase.possible_publishers]
    state = _way_to_state(phase.possible_publishers)
    return Finding(
        message=f"no {'known ' if unknown else ''}publisher on {_topic_text(unpublished)}",
        path=subscription.path,
        key=subscription.topic_is_key,
        help="; or ".join(part for part in (_advice(unpublished), state) if part),
        related=_misspelt_publisher(unpublished),
        severity="warning" if unknown else None,
        suppressed_by={
            topic_key(phase.phase, subscription.topic),
            *(value_key(node.path) for node in phase.possible_publishers),
        },
        suppresses=_consequences(unpublished),
    )


def _sources(unpublished: _UnpublishedTopic) -> Iterator[tuple[NodeWiring, InterfaceSource]]:
    """The sources of it: that the node subscribes, and that the others do not publish."""
    for node in unpublished.phase.nodes:
        own = node is unpublished.node
        yield node, node.interface.subscribes_from if own else node.interface.publishes_from


def _way_to_state(unknown: tuple[NodeWiring, ...]) -> str:
    """How the unknown publishers of nodes can be stated; empty if there are no such nodes."""
    if not unknown:
        return ""
    names = quoted_list(node.key for node in unknown)
    recorded = any(not node.node.kind.by_others for node in unknown)
    way = ", or record them with 'r2bspec interfaces'" if recorded else ""
    return f"list the topics of {names} under 'publishes:'{way}"


def _topic_text(unpublished: _UnpublishedTopic) -> str:
    """The topic and its subscriber."""
    subscription, node = unpublished.subscription, unpublished.node
    subscriber = node.key if node is not None else f"monitor {subscription.monitor}"
    text = f"{quote(unpublished.topic_name)}, to which {subscriber} subscribes"
    if node is not None and "remappings" in subscription.path:
        return f"{text} as {quote(subscription.own_name)}"
    return text


def _advice(unpublished: _UnpublishedTopic) -> str:
    if unpublished.close:
        return f"did you mean {quote(unpublished.relative_name(unpublished.close))}?"
    fitting = [
        shown for shown, name in unpublished.candidates.items() if unpublished.type_matches(name)
    ]
    if unpublished.node is None or not unpublished.subscription.topic_is_key or not fitting:
        return (
            f"published topics: {quoted_list(unpublished.candidates)}"
            if unpublished.candidates
            else ""
        )
    if len(fitting) == 1:
        return (
            "remap it: "
            f"{quote(f'remappings: {{{unpublished.subscription.own_name}: {fitting[0]}}}')}"
        )
    return f"remap it; published topics of its type: {quoted_list(fitting)}"


def _misspelt_publisher(unpublished: _UnpublishedTopic) -> tuple[Pointer, ...]:
    """The publisher of the close name, if it has no subscription: it may be the misspelt one."""
    if not unpublished.close or unpublished.phase.subscriptions(unpublished.close):
        return ()
    publisher = unpublished.phase.publishers(unpublished.close)[0]
    shown = quote(unpublished.context.relative_name(unpublished.close))
    return (Pointer(f"{shown} has no subscription", publisher.path, publisher.topic_is_key),)


def _consequences(unpublished: _UnpublishedTopic) -> set[str]:
    """The topic, and those without a subscription because this one is subscribed to instead."""
    phase = unpublished.phase
    instead = {
        name
        for name in unpublished.published
        if not phase.subscriptions(name)
        and (name == unpublished.close or unpublished.type_matches(name))
    }
    topics = (unpublished.subscription.topic, *instead)
    return {flow_key(phase.phase), *(topic_key(phase.phase, name) for name in topics)}


RULE = Rule(code="R2B207", find=_find)
