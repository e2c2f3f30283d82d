"""Topics that are read although nobody publishes them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

from r2bspec.check import suppression_keys
from r2bspec.check.check_context import Context
from r2bspec.check.example_spec import example
from r2bspec.check.finding import Finding, Pointer
from r2bspec.check.message_text import MOST_SUGGESTIONS, listed
from r2bspec.check.rule import Rule
from r2bspec.diagnostics import did_you_mean
from r2bspec.diagnostics.diagnostic import Severity
from r2bspec.diagnostics.quote import quote
from r2bspec.wiring.name_resolution import SHARED_TOPICS
from r2bspec.wiring.wiring import Endpoint, NodeWiring, PhaseWiring


def _find(context: Context) -> Iterator[Finding]:
    found = 0
    for phase in context.wiring.phases:
        published = tuple(name for name in phase.topics if phase.writers(name))
        for reader in phase.endpoints:
            if reader.topic in SHARED_TOPICS and reader.is_node:
                continue
            # What the recorder reads is a playback input's 'from', which has a rule of its own.
            if not reader.writes and reader.owner != "recorder" and not phase.writers(reader.topic):
                found += 1
                names = published if found <= MOST_SUGGESTIONS else ()
                yield _finding(_Place(context, phase, reader, names))


@dataclass(frozen=True)
class _Place:
    """A topic that is read in vain, and the topics that might have been meant."""

    context: Context
    phase: PhaseWiring
    reader: Endpoint
    published: tuple[str, ...]

    @cached_property
    def node(self) -> NodeWiring | None:
        """The node that reads it; None for a monitor."""
        return self.phase.node(self.reader.owner)

    @cached_property
    def shown(self) -> str:
        """The topic as one would write it here."""
        return self.written(self.reader.topic)

    def written(self, topic: str) -> str:
        """Any topic as one would write it here."""
        return self.context.shown(topic, self.node.namespace if self.node else "")

    @cached_property
    def candidates(self) -> dict[str, str]:
        """The topics that are published, by the name that one would write here."""
        return {self.written(name): name for name in self.published if not self._own(name)}

    def _own(self, topic: str) -> bool:
        return any(writer.owner == self.reader.owner for writer in self.phase.writers(topic))

    @cached_property
    def close(self) -> str:
        """The full name of the published topic that is most like it, or empty."""
        return self.candidates.get(did_you_mean(self.shown, self.candidates), "")

    def fits(self, topic: str) -> bool:
        """Whether a topic has the type that is read, as far as known."""
        return any(each.type in {self.reader.type, ""} for each in self.phase.writers(topic))


def _finding(place: _Place) -> Finding:
    phase, reader = place.phase, place.reader
    unknown = [node.key for node in phase.may_write]
    if unknown:
        message = f"nobody is known to publish {_named(place)}"
        state = f"state what {listed(unknown)} publishes under 'publishes:' there"
    else:
        message = f"nobody publishes {_named(place)}"
        state = ""
    return Finding(
        message=message,
        path=reader.path,
        key=reader.at_key,
        help="; or ".join(part for part in (_advice(place), state) if part),
        related=_misspelt(place),
        severity=Severity.WARNING if unknown else None,
        about=frozenset({suppression_keys.topic(phase.phase, reader.topic)})
        | {suppression_keys.value(node.path) for node in phase.may_write},
        explains=_consequences(place),
    )


def _named(place: _Place) -> str:
    """The topic, with who reads it and how."""
    reader, node = place.reader, place.node
    if node is None:
        return f"{quote(place.shown)}, which monitor {reader.monitor} watches"
    if "remappings" in reader.path:
        return f"{quote(place.shown)}, which {node.key} reads as {quote(reader.own_name)}"
    return f"{quote(place.shown)}, which {node.key} reads"


def _advice(place: _Place) -> str:
    if place.close:
        return f"did you mean {quote(place.written(place.close))}?"
    fitting = [shown for shown, name in place.candidates.items() if place.fits(name)]
    if place.node is None or not place.reader.at_key or not fitting:
        return f"topics that are published: {listed(place.candidates)}" if place.candidates else ""
    if len(fitting) == 1:
        return f"remap it: {quote(f'remappings: {{{place.reader.own_name}: {fitting[0]}}}')}"
    return f"remap it; topics of its type are {listed(fitting)}"


def _misspelt(place: _Place) -> tuple[Pointer, ...]:
    """The place of the topic that may be the one with the wrong name, if nobody reads it."""
    if not place.close or place.phase.readers(place.close):
        return ()
    writer = place.phase.writers(place.close)[0]
    shown = quote(place.context.shown(place.close))
    return (Pointer(f"{shown}, which nobody reads", writer.path, writer.at_key),)


def _consequences(place: _Place) -> frozenset[str]:
    """The topic itself, and those that nobody reads because this one is read in their place."""
    phase = place.phase
    instead = {
        name
        for name in place.published
        if not phase.readers(name) and (name == place.close or place.fits(name))
    }
    topics = {suppression_keys.topic(phase.phase, name) for name in (place.reader.topic, *instead)}
    return frozenset({suppression_keys.flow(phase.phase)} | topics)


RULE = Rule(
    code="R2B207",
    title="a topic is read that nobody publishes",
    severity=Severity.ERROR,
    why="Whoever reads it waits for ever. Where the interfaces of all nodes are known this is "
    "certain; otherwise it is a warning that says of which nodes nothing is known.",
    failing=example(
        graph="""
            nodes:
              relay:
                python: r2bspec.nodes.RelayNode
                remappings: {input: imgae}
        """
    ),
    passing=example(
        graph="""
            nodes:
              relay:
                python: r2bspec.nodes.RelayNode
                remappings: {input: image}
        """
    ),
    find=_find,
)
