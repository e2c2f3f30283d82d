"""Private topic names, with '~', outside of a node."""

from __future__ import annotations

from collections.abc import Iterator

from r2bspec.check.rule_api import (
    Context,
    Finding,
    Findings,
    Path,
    Rule,
    flow_key,
    quote,
    topic_key,
)


def _find(context: Context) -> Findings:
    for name, path, phase, key in _harness_topics(context):
        if not name.startswith("~"):
            continue
        private = [topic for topic in _private_topics(context, phase) if topic.endswith(name[1:])]
        topics = (*private, context.harness_topic(name))
        yield Finding(
            message=f"private topic {quote(name)} is used outside of a node",
            path=path,
            key=key,
            help=f"did you mean {quote(context.relative_name(private[0]))}?"
            if len(private) == 1
            else "write the full name: namespace, node name, topic",
            suppresses={flow_key(phase), *(topic_key(phase, topic) for topic in topics)},
        )


def _private_topics(context: Context, phase: str) -> list[str]:
    """The topics of a phase under the name of one of its nodes."""
    return [
        topic
        for wiring in context.wiring.phases
        if wiring.phase == phase
        for topic in wiring.topics
        if any(topic.startswith(f"{node.name}/") for node in wiring.nodes)
    ]


def _harness_topics(context: Context) -> Iterator[tuple[str, Path, str, bool]]:
    """Each topic that the spec names outside of nodes: name, path, phase, whether it is a key."""
    spec = context.spec
    for bag_topic, target in spec.data_loader.topics.items():
        yield target, ("data_loader", "topics", bag_topic), "preprocess", False
    for name, each in spec.playback.inputs.items():
        yield name, ("playback", "inputs", name), "measure", True
        yield each.source, ("playback", "inputs", name, "from"), "preprocess", False
    for name, monitor in spec.monitors.items():
        yield monitor.topic, ("monitors", name, "topic"), "measure", False


RULE = Rule(code="R2B201", find=_find)
