"""Settings of a process at a node that has none of its own."""

from __future__ import annotations

from r2bspec.check.rule_api import Context, Finding, Findings, NodeWiring, Rule, example, quote

_PROCESS_KEYS = ("cpus", "nice", "prefix", "memory_limit")


def _find(context: Context) -> Findings:
    for _, node in context.nodes:
        shared = _why_shared(context, node)
        for name in _PROCESS_KEYS if shared else ():
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
    if node.node.kind == "external":
        return "it must already run"
    if node.node.container:
        return f"it runs in the container {node.node.container}"
    placement = context.spec.graph.placement
    shares = node.path[0] == "graph" and node.node.kind in {"python", "plugin"}
    if placement == "separate" or not shares:
        return ""
    return f"with 'placement: {placement}' it shares a process"


RULE = Rule(
    code="R2B221",
    title="a setting of a process at a node that has none",
    severity="warning",
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
