"""Topics that are read although nobody publishes them."""

from __future__ import annotations

from collections.abc import Iterator

from r2bspec.check import subjects
from r2bspec.check.context import Context
from r2bspec.check.example import example
from r2bspec.check.finding import Finding, Pointer
from r2bspec.check.rule import Rule
from r2bspec.check.words import listed, suggestion
from r2bspec.diagnostics import did_you_mean
from r2bspec.diagnostics.model import Severity
from r2bspec.diagnostics.quote import quote
from r2bspec.wiring.model import Endpoint, PhaseWiring


def _find(context: Context) -> Iterator[Finding]:
    for phase in context.wiring.phases:
        for reader in phase.endpoints:
            # What the recorder reads is a playback input's 'from', which has a rule of its own.
            if not reader.writes and reader.owner != "recorder" and not phase.writers(reader.topic):
                yield _finding(context, phase, reader)


def _finding(context: Context, phase: PhaseWiring, reader: Endpoint) -> Finding:
    unknown = [node.key for node in phase.may_write]
    if unknown:
        message = f"nobody is known to publish {_named(context, phase, reader)}"
        state = f"state what {listed(unknown)} publishes under 'publishes:' there"
    else:
        message = f"nobody publishes {_named(context, phase, reader)}"
        state = ""
    advice = _advice(context, phase, reader)
    return Finding(
        message=message,
        path=reader.path,
        key=reader.at_key,
        help="; or ".join(part for part in (advice, state) if part),
        related=_misspelt(context, phase, reader),
        severity=Severity.WARNING if unknown else None,
        about=frozenset({subjects.topic(phase.phase, reader.topic)})
        | {subjects.value(node.path) for node in phase.may_write},
        explains=_consequences(context, phase, reader),
    )


def _named(context: Context, phase: PhaseWiring, reader: Endpoint) -> str:
    """The topic, with who reads it and how."""
    if reader.owner == "monitor":
        return f"{quote(context.shown(reader.topic))}, which monitor {reader.monitor} watches"
    node = next(node for node in phase.nodes if node.name == reader.owner)
    shown = quote(context.shown(reader.topic, node.namespace))
    if "remappings" in reader.path:
        return f"{shown}, which {node.key} reads as {quote(reader.own_name)}"
    return f"{shown}, which {node.key} reads"


def _advice(context: Context, phase: PhaseWiring, reader: Endpoint) -> str:
    namespace = next((node.namespace for node in phase.nodes if node.name == reader.owner), "")
    wrong = context.shown(reader.topic, namespace)
    published = {context.shown(name, namespace): name for name in _published(phase)}
    if did_you_mean(wrong, published) or reader.owner == "monitor" or not reader.at_key:
        return suggestion(wrong, published, "topics that are published")
    fitting = [
        shown
        for shown, name in published.items()
        if reader.type in _types(phase, name) and not _writes(phase, reader.owner, name)
    ]
    if not fitting:
        return suggestion(wrong, published, "topics that are published")
    if len(fitting) == 1:
        return f"remap it: {quote(f'remappings: {{{reader.own_name}: {fitting[0]}}}')}"
    return f"remap it; topics of its type are {listed(fitting)}"


def _misspelt(context: Context, phase: PhaseWiring, reader: Endpoint) -> tuple[Pointer, ...]:
    """The place of a topic that nobody reads, and that may be the one with the wrong name."""
    unread = {
        context.shown(name): name
        for name in _published(phase)
        if not phase.readers(name) and not _writes(phase, reader.owner, name)
    }
    close = did_you_mean(context.shown(reader.topic), unread)
    return tuple(
        Pointer(f"{quote(close)}, which nobody reads", each.path, each.at_key)
        for each in phase.writers(unread.get(close, ""))[:1]
    )


def _consequences(context: Context, phase: PhaseWiring, reader: Endpoint) -> frozenset[str]:
    """The topic itself, and those that nobody reads because this one is read in their place."""
    wrong = context.shown(reader.topic)
    instead = {
        name
        for name in _published(phase)
        if not phase.readers(name)
        and (did_you_mean(wrong, [context.shown(name)]) or reader.type in _types(phase, name))
    }
    topics = {subjects.topic(phase.phase, name) for name in (reader.topic, *instead)}
    return frozenset({subjects.flow(phase.phase)} | topics)


def _published(phase: PhaseWiring) -> list[str]:
    return [name for name in phase.topics if phase.writers(name)]


def _writes(phase: PhaseWiring, owner: str, topic: str) -> bool:
    return any(writer.owner == owner for writer in phase.writers(topic))


def _types(phase: PhaseWiring, topic: str) -> set[str]:
    return {each.type for each in phase.writers(topic)} | {""}


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
