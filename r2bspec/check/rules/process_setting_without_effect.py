"""Process settings of nodes without their own process."""

from __future__ import annotations

from r2bspec.check.rule_api import Context, Finding, Findings, NodeWiring, Rule, quote
from r2bspec.language.node_kinds import PROCESS_KEYS


def _find(context: Context) -> Findings:
    for _, node in context.nodes:
        shared = _why_shared(context, node)
        for name in PROCESS_KEYS if shared else ():
            if getattr(node.node, name):
                yield Finding(
                    message=f"{quote(name)} of {node.key} has no effect: {shared}",
                    path=(*node.path, name),
                    key=True,
                    help="set it for the container"
                    if node.node.container
                    else "give the node its own container or process",
                )


def _why_shared(context: Context, node: NodeWiring) -> str:
    """Why a node does not have its own process; empty if it has."""
    if node.node.kind.role is None:
        return "a run does not start external nodes"
    if node.node.container:
        return f"the node runs in container {node.node.container}"
    placement = context.spec.graph.placement
    shares = node.path[0] == "graph" and node.shares_process
    if placement == "separate" or not shares:
        return ""
    return f"with 'placement: {placement}' the node shares a process"


RULE = Rule(code="R2B221", find=_find)
