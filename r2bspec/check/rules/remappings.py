"""Remappings of nodes: ROS ignores one that matches nothing, and says nothing of it."""

from __future__ import annotations

from r2bspec.check.check_context import Context
from r2bspec.check.rule import (
    COMPLETE_SOURCES,
    Finding,
    Findings,
    Pointer,
    as_version_warning,
    flow_key,
    rule,
    topic_key,
    with_record,
)
from r2bspec.diagnostics.quote import MAX_SUGGESTIONS, did_you_mean, quote, quoted_list
from r2bspec.wiring.wiring import NodeWiring

_COMMON_TOPICS = ("/rosout", "/parameter_events", "/clock")
_NODE_REMAPPINGS = {"__ns": "namespace", "__node": "", "__name": ""}


@rule("R2B204")
def remapping_unmatched(context: Context) -> Findings:
    """Remappings that match no topic of their node."""
    count = 0
    for phase, node in context.nodes:
        topics = _NodeTopics(phase, node)
        for left, right in node.node.remappings.items():
            if left in _NODE_REMAPPINGS:
                yield _node_remapping_finding(phase, node, left)
            elif topics.known is not None and node.names.full(left) not in topics.known:
                count += 1
                finding = _unmatched_finding(topics, left, right, suggest=count <= MAX_SUGGESTIONS)
                interface = node.interface
                sources = (interface.subscribes_from, interface.publishes_from)
                yield with_record(context, finding, *((node, source) for source in sources))


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
            self.known = frozenset((*_COMMON_TOPICS, *map(node.names.full, names)))
        self._remapped: frozenset[str] | None = None

    def used_instead(self, close: str) -> frozenset[str]:
        """The topics that may be used instead of the intended one.

        Without a close name these are all topics of the node. They are given once: what one finding
        suppresses, later ones need not name again.
        """
        if not close and self._remapped is not None:
            return frozenset()
        own = (close,) if close else self.own
        names = frozenset(self.node.names.resolve(name).name for name in own)
        if not close:
            self._remapped = names
        return names


def _unmatched_finding(topics: _NodeTopics, left: str, right: str, *, suggest: bool) -> Finding:
    node, own = topics.node, topics.own
    close = did_you_mean(left, own) if suggest else ""
    # The spec may state topics only; services are remapped in the same way.
    sources = {node.interface.subscribes_from, node.interface.publishes_from}
    instead = {node.names.full(left), node.names.full(right), *topics.used_instead(close)}
    finding = Finding(
        message=f"{node.key} has no topic {quote(left)} to remap",
        path=(*node.path, "remappings", left),
        key=True,
        help=_unmatched_help(left, right, close, own),
        severity=None if sources <= COMPLETE_SOURCES else "warning",
        suppresses={flow_key(topics.phase), *(topic_key(topics.phase, topic) for topic in instead)},
    )
    return as_version_warning(node.interface, finding) if "catalogue" in sources else finding


def _unmatched_help(left: str, right: str, close: str, own: tuple[str, ...]) -> str:
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


@rule("R2B205")
def remapping_shadowed(context: Context) -> Findings:
    """Remappings that have no effect because an earlier one matches the same topic."""
    for phase, node in context.nodes:
        first: dict[str, str] = {}
        for left, right in node.node.remappings.items():
            full = node.names.full(left)
            if full not in first:
                first[full] = left
                continue
            place = (*node.path, "remappings")
            yield Finding(
                message=f"{quote(left)} and {quote(first[full])} remap the same topic, {full}",
                path=(*place, left),
                key=True,
                help="remove one of them; ROS applies only the first",
                related=(Pointer("first remapping of the topic", (*place, first[full]), key=True),),
                suppresses={topic_key(phase, node.names.full(right))},
            )


@rule("R2B206")
def remapping_identity(context: Context) -> Findings:
    """Remappings of a topic to itself."""
    for _, node in context.nodes:
        for left, right in node.node.remappings.items():
            full = node.names.full(left)
            if full == node.names.full(right):
                also = "" if left == right else f": both names resolve to {full}"
                yield Finding(
                    message=f"{quote(left)} is remapped to itself{also}",
                    path=(*node.path, "remappings", left),
                    key=True,
                    help="remove the remapping",
                )
