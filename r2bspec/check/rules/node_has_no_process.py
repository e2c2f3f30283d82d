"""Settings of a process at a node that has none of its own."""

from __future__ import annotations

from r2bspec.check.rule_api import (
    Context,
    Finding,
    Iterator,
    NodeWiring,
    Rule,
    Severity,
    example,
    quote,
)
from r2bspec.language.node_kinds import PROCESS_KEYS


def _find(context: Context) -> Iterator[Finding]:
    for _, node in context.nodes:
        shared = _why_shared(context, node)
        for name in PROCESS_KEYS if shared else ():
            if getattr(node.node, name):
                yield Finding(
                    message=f"{quote(name)} of {node.key} has no effect: {shared}",
                    path=(*node.path, name),
                    key=True,
                    help="write it for the container"
                    if node.node.container
                    else "give the node a container, or a process of its own",
                )


def _why_shared(context: Context, node: NodeWiring) -> str:
    """Why a node has no process of its own; empty if it has."""
    if node.node.kind.role is None:
        return "it must already run"
    if node.node.container:
        return f"it runs in the container {node.node.container}"
    placement = context.spec.graph.placement
    shares = node.path[0] == "graph" and node.node.kind.shares_process
    if placement == "separate" or not shares:
        return ""
    return f"with 'placement: {placement}' it shares a process"


RULE = Rule(
    code="R2B221",
    title="a setting of a process at a node that has none",
    severity=Severity.WARNING,
    why="Priority, processors, memory and the words before the command belong to a process. A node "
    "in a container shares that of the others.",
    failing=example(
        graph="""
            placement: shared
            nodes:
              relay:
                python: r2bspec.nodes.RelayNode
                nice: 5
                remappings: {input: image}
        """
    ),
    passing=example(
        graph="""
            placement: separate
            nodes:
              relay:
                python: r2bspec.nodes.RelayNode
                nice: 5
                remappings: {input: image}
        """
    ),
    find=_find,
)
