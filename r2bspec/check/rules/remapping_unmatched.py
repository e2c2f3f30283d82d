"""Remappings that match no topic of their node."""

from __future__ import annotations

from r2bspec.check.certainty import COMPLETE_SOURCES, as_version_warning, with_record
from r2bspec.check.rule_api import (
    MAX_SUGGESTIONS,
    Context,
    Finding,
    Findings,
    NodeWiring,
    Rule,
    did_you_mean,
    flow_key,
    quote,
    quoted_list,
    topic_key,
)
from r2bspec.wiring.name_resolution import Remapper, expand

_COMMON_TOPICS = ("/rosout", "/parameter_events", "/clock")

_NODE_REMAPPINGS = {"__ns": "namespace", "__node": "", "__name": ""}


def _find(context: Context) -> Findings:
    found = 0
    for phase, node in context.nodes:
        topics = _NodeTopics(phase, node)
        for left, right in node.node.remappings.items():
            if left in _NODE_REMAPPINGS:
                yield _node_remapping_finding(phase, node, left)
            elif topics.known is not None and topics.full(left) not in topics.known:
                found += 1
                finding = _finding(topics, left, right, suggest=found <= MAX_SUGGESTIONS)
                interface = node.interface
                sources = (interface.subscribes_from, interface.publishes_from)
                yield with_record(context, finding, *((node, each) for each in sources))


class _NodeTopics:
    """The topics of one node, expanded and remapped once for all of its remappings.

    Attributes:
        phase: the name of the phase of the node.
        node: the node.
        own: the topics in the code of the node.
        known: the full names that a remapping may have; None if they are not all known.
    """

    def __init__(self, phase: str, node: NodeWiring) -> None:
        self.phase = phase
        self.node = node
        self.own = node.interface.topics or ()
        self.known: frozenset[str] | None = None
        all_known = node.interface.topics is not None and not node.node.kind.names_own_nodes
        if node.node.remappings and all_known:
            names = (*self.own, *node.interface.other_remappable_names)
            self.known = frozenset((*_COMMON_TOPICS, *map(self.full, names)))
        self._remapped: frozenset[str] | None = None

    def full(self, name: str) -> str:
        """The full name of a topic before remapping."""
        return expand(name, self.node.key, self.node.namespace)

    def used_instead(self, close: str) -> frozenset[str]:
        """The topics that may be used instead of the intended one.

        Without a close name these are all topics of the node. They are given once: what one finding
        suppresses, later ones need not name again.
        """
        if not close and self._remapped is not None:
            return frozenset()
        node = self.node
        remapper = Remapper(node.node.remappings, node.key, node.namespace)
        names = frozenset(remapper.resolve(name).name for name in ((close,) if close else self.own))
        if not close:
            self._remapped = names
        return names


def _finding(topics: _NodeTopics, left: str, right: str, *, suggest: bool) -> Finding:
    node, own = topics.node, topics.own
    close = did_you_mean(left, own) if suggest else ""
    # The spec may state topics only; services are remapped in the same way.
    sources = {node.interface.subscribes_from, node.interface.publishes_from}
    instead = {topics.full(left), topics.full(right), *topics.used_instead(close)}
    finding = Finding(
        message=f"{node.key} has no topic {quote(left)} to remap",
        path=(*node.path, "remappings", left),
        key=True,
        help=_help(left, right, close, own),
        severity=None if sources <= COMPLETE_SOURCES else "warning",
        suppresses={flow_key(topics.phase), *(topic_key(topics.phase, each) for each in instead)},
    )
    return as_version_warning(node.interface, finding) if "catalogue" in sources else finding


def _help(left: str, right: str, close: str, own: tuple[str, ...]) -> str:
    if close:
        return f"did you mean {quote(close)}?"
    if right in own:
        turned = quote(f"{right}: {left}")
        return f"the topic name of the node comes first: {turned}"
    return f"its topics: {quoted_list(own)}"


def _node_remapping_finding(phase: str, node: NodeWiring, left: str) -> Finding:
    instead = _NODE_REMAPPINGS[left]
    return Finding(
        message=f"{quote(left)} is not a topic; in ROS it renames the node",
        path=(*node.path, "remappings", left),
        key=True,
        help=f"set {quote(instead)} of the node" if instead else "rename the node's key instead",
        suppresses={flow_key(phase)},
    )


RULE = Rule(code="R2B204", find=_find)
