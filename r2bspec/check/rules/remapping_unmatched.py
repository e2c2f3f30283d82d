"""Remappings that match no topic of their node."""

from __future__ import annotations

from r2bspec.check.certainty import COMPLETE_SOURCES, as_version_warning
from r2bspec.check.rule_api import (
    Context,
    Finding,
    Findings,
    NodeWiring,
    Rule,
    did_you_mean,
    example,
    flow_key,
    quote,
    quoted_list,
    topic_key,
)
from r2bspec.wiring.name_resolution import expand, remap

_COMMON_TOPICS = ("/rosout", "/parameter_events", "/clock")

_NODE_REMAPPINGS = {"__ns": "namespace", "__node": "", "__name": ""}


def _find(context: Context) -> Findings:
    for phase, node in context.nodes:
        for left, right in node.node.remappings.items():
            if left in _NODE_REMAPPINGS:
                yield _node_remapping_finding(phase, node, left)
            elif _matches_nothing(node, left):
                yield _finding(phase, node, left, right)


def _matches_nothing(node: NodeWiring, left: str) -> bool:
    own = node.interface.topics
    if own is None or node.node.kind.names_own_nodes:
        return False
    full = expand(left, node.key, node.namespace)
    known = {
        expand(name, node.key, node.namespace)
        for name in (*own, *node.interface.other_remappable_names)
    }
    return full not in known and full not in _COMMON_TOPICS


def _finding(phase: str, node: NodeWiring, left: str, right: str) -> Finding:
    own = node.interface.topics or ()
    close = did_you_mean(left, own)
    # The spec may state topics only; services are remapped in the same way.
    sources = {node.interface.subscribes_from, node.interface.publishes_from}
    finding = Finding(
        message=f"{node.key} has no topic {quote(left)} to remap",
        path=(*node.path, "remappings", left),
        key=True,
        help=_help(left, right, close, own),
        severity=None if sources <= COMPLETE_SOURCES else "warning",
        suppresses=_consequences(phase, node, (left, right), close),
    )
    return as_version_warning(node.interface, finding) if "catalogue" in sources else finding


def _help(left: str, right: str, close: str, own: tuple[str, ...]) -> str:
    if close:
        return f"did you mean {quote(close)}?"
    if right in own:
        turned = quote(f"{right}: {left}")
        return f"the topic name of the node comes first: {turned}"
    return f"its topics: {quoted_list(own)}"


def _consequences(phase: str, node: NodeWiring, rule: tuple[str, str], close: str) -> set[str]:
    """The intended topics, and those that are used instead."""
    own = (close,) if close else node.interface.topics or ()
    rules = node.node.remappings
    topics = {expand(name, node.key, node.namespace) for name in rule}
    topics |= {remap(name, rules, node.key, node.namespace).name for name in own}
    return {flow_key(phase), *(topic_key(phase, name) for name in topics)}


def _node_remapping_finding(phase: str, node: NodeWiring, left: str) -> Finding:
    instead = _NODE_REMAPPINGS[left]
    return Finding(
        message=f"{quote(left)} is not a topic; in ROS it renames the node",
        path=(*node.path, "remappings", left),
        key=True,
        help=f"set {quote(instead)} of the node" if instead else "rename the node's key instead",
        suppresses={flow_key(phase)},
    )


RULE = Rule(
    code="R2B204",
    title="remapping matches no topic of the node",
    severity="error",
    why="ROS ignores a remapping that matches no topic and prints no warning. The node keeps its "
    "own topic name, and no message arrives.",
    failing=example(
        graph="""
            nodes:
              relay:
                python: r2bspec.nodes.RelayNode
                remappings: {inptu: image}
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
