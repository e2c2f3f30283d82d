"""Topics of the graph: names, and publishers that meet subscriptions.

A misspelt name leaves one topic without a publisher and another without a subscription. The first
finding therefore suppresses its consequences; see `r2bspec.check.engine`.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

from r2bspec.check.check_context import Context
from r2bspec.check.rule import (
    Finding,
    Findings,
    Pointer,
    flow_key,
    rule,
    topic_key,
    value_key,
    why_unknown,
    with_record,
)
from r2bspec.diagnostics.quote import MAX_SUGGESTIONS, did_you_mean, quote, quoted_list, suggestion
from r2bspec.plan.wiring.name_resolution import NODE_TOPICS, SHARED_TOPICS
from r2bspec.plan.wiring.node_interface import InterfaceSource
from r2bspec.plan.wiring.wiring import NodeWiring, PhaseWiring, WiredEndpoint


@rule("R2B207")
def topic_without_publisher(context: Context) -> Findings:
    """Find subscribed topics without a publisher."""
    count = 0
    for phase in context.wiring.phases:
        published = tuple(name for name in phase.topics if phase.publishers(name))
        for subscription in phase.endpoints:
            if subscription.topic in SHARED_TOPICS and subscription.is_node:
                continue
            if subscription.topic in NODE_TOPICS:
                continue
            # The recorder subscribes to the 'from' of playback inputs: see R2B401.
            if (
                not subscription.is_publisher
                and subscription.owner != "recorder"
                and not phase.publishers(subscription.topic)
            ):
                count += 1
                names = published if count <= MAX_SUGGESTIONS else ()
                unpublished = _UnpublishedTopic(context, phase, subscription, names)
                yield with_record(context, unpublished.finding(), *unpublished.sources())


@dataclass(frozen=True)
class _UnpublishedTopic:
    """A subscription without a publisher, and the published topics that may have been meant."""

    context: Context
    phase: PhaseWiring
    subscription: WiredEndpoint
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
        """Return whether a topic has the type of the subscription, or an unknown one."""
        return any(
            publisher.type in {self.subscription.type, ""}
            for publisher in self.phase.publishers(topic)
        )

    def finding(self) -> Finding:
        """Return what is said of it."""
        phase, subscription = self.phase, self.subscription
        unknown = [node.key for node in phase.possible_publishers]
        state = _way_to_state(phase.possible_publishers)
        return Finding(
            message=f"no {'known ' if unknown else ''}publisher on {self._topic_text()}",
            path=subscription.path,
            key=subscription.topic_is_key,
            help="; or ".join(part for part in (self._advice(), state) if part),
            related=self._misspelt_publisher(),
            severity="warning" if unknown else None,
            suppressed_by={
                topic_key(phase.phase, subscription.topic),
                *(value_key(node.path) for node in phase.possible_publishers),
            },
            suppresses=self._consequences(),
        )

    def sources(self) -> Iterator[tuple[NodeWiring, InterfaceSource]]:
        """Yield the sources of it: that the node subscribes, and that the others do not publish."""
        for node in self.phase.nodes:
            own = node is self.node
            yield node, node.interface.subscribes_from if own else node.interface.publishes_from

    def _topic_text(self) -> str:
        """Return the topic and its subscriber."""
        subscription, node = self.subscription, self.node
        subscriber = node.key if node is not None else f"monitor {subscription.monitor}"
        text = f"{quote(self.topic_name)}, to which {subscriber} subscribes"
        if node is not None and "remappings" in subscription.path:
            return f"{text} as {quote(subscription.own_name)}"
        return text

    def _advice(self) -> str:
        if self.close:
            return f"did you mean {quote(self.relative_name(self.close))}?"
        fitting = [shown for shown, name in self.candidates.items() if self.type_matches(name)]
        if self.node is None or not self.subscription.topic_is_key or not fitting:
            return f"published topics: {quoted_list(self.candidates)}" if self.candidates else ""
        if len(fitting) == 1:
            return (
                f"remap it: {quote(f'remappings: {{{self.subscription.own_name}: {fitting[0]}}}')}"
            )
        return f"remap it; published topics of its type: {quoted_list(fitting)}"

    def _misspelt_publisher(self) -> tuple[Pointer, ...]:
        """Return the publisher with the similar name, if it has no subscription."""
        if not self.close or self.phase.subscriptions(self.close):
            return ()
        publisher = self.phase.publishers(self.close)[0]
        shown = quote(self.context.relative_name(self.close))
        known = "known " if self.phase.possible_subscribers else ""
        message = f"{shown} has no {known}subscription"
        return (Pointer(message, publisher.path, publisher.topic_is_key),)

    def _consequences(self) -> set[str]:
        """Return the topic, and the topics that lack its subscription."""
        phase = self.phase
        instead = {
            name
            for name in self.published
            if not phase.subscriptions(name) and (name == self.close or self.type_matches(name))
        }
        topics = (self.subscription.topic, *instead)
        return {flow_key(phase.phase), *(topic_key(phase.phase, name) for name in topics)}


def _way_to_state(unknown: tuple[NodeWiring, ...]) -> str:
    """Return how the unknown publishers of nodes can be stated.

    Empty if there are no such nodes.
    """
    if not unknown:
        return ""
    names = quoted_list(node.key for node in unknown)
    recorded = any(not node.node.kind.by_others for node in unknown)
    way = ", or record them with 'r2bspec interfaces'" if recorded else ""
    return f"list the topics of {names} under 'publishes:'{way}{why_unknown(unknown)}"


@rule("R2B208")
def topic_without_subscription(context: Context) -> Findings:
    """Find topics that the spec plays or remaps, but to which no node or monitor subscribes."""
    # R2B401 covers the preprocess phase.
    phase = context.wiring.measure
    if phase.possible_subscribers:
        return
    subscribed = [context.relative_name(name) for name in phase.topics if phase.subscriptions(name)]
    count = 0
    for publisher in phase.endpoints:
        if not publisher.is_publisher or phase.subscriptions(publisher.topic):
            continue
        if not _is_intended(publisher):
            continue
        count += 1
        shown = context.relative_name(publisher.topic)
        which = (
            "which is played"
            if publisher.owner == "player"
            else f"to which {quote(publisher.own_name)} is remapped"
        )
        yield Finding(
            message=f"no subscription to {quote(shown)}, {which}",
            path=publisher.path,
            key=publisher.topic_is_key,
            help=suggestion(
                shown, subscribed if count <= MAX_SUGGESTIONS else [], "subscribed topics"
            ),
            suppressed_by={topic_key(phase.phase, publisher.topic)},
        )


def _is_intended(publisher: WiredEndpoint) -> bool:
    """Return True if the spec names the topic; other outputs are often unused."""
    if publisher.topic in SHARED_TOPICS:
        return False
    return publisher.owner == "player" or "remappings" in publisher.path


_HARNESS_LABELS = {"loader": "the data loader", "player": "the player"}


@rule("R2B209")
def topic_with_two_publishers(context: Context) -> Findings:
    """Find topics with several publishers."""
    for phase in context.wiring.phases:
        for topic in set(phase.topics) - SHARED_TOPICS:
            publishers = phase.publishers(topic)
            for second in publishers[1:]:
                yield _two_publishers(context, phase, publishers[0], second)


def _two_publishers(
    context: Context, phase: PhaseWiring, first: WiredEndpoint, second: WiredEndpoint
) -> Finding:
    shown = quote(context.relative_name(first.topic))
    if first.owner == second.owner:
        message = f"{_publisher_label(first)} publishes {shown} twice"
    else:
        message = f"{_publisher_label(first)} and {_publisher_label(second)} both publish {shown}"
    mixed = not (first.is_node and second.is_node)
    return Finding(
        message=message,
        path=second.path,
        key=second.topic_is_key,
        help="rename one of the two topics",
        related=(Pointer("other publisher", first.path, first.topic_is_key),),
        severity="error" if mixed else None,
        suppressed_by={topic_key(phase.phase, first.topic)},
        suppresses={flow_key(phase.phase)} if mixed else set(),
    )


def _publisher_label(endpoint: WiredEndpoint) -> str:
    return _HARNESS_LABELS.get(endpoint.owner, endpoint.owner.rpartition("/")[2])
