"""Nodes of one process that set an environment variable to different values."""

from __future__ import annotations

from r2bspec.check.rule_api import (
    Context,
    Finding,
    Findings,
    NodeWiring,
    Path,
    Pointer,
    Rule,
)


def _find(context: Context) -> Findings:
    first: dict[tuple[str, str], tuple[str, Path]] = {}
    for _, node in context.nodes:
        process = _shared_process(context, node)
        for name, value in node.node.env.items() if process else ():
            path = (*node.path, "env", name)
            other_value, other_path = first.setdefault((process, name), (value, path))
            if other_value != value:
                yield Finding(
                    message=f"nodes of one process set different values of {name}",
                    path=path,
                    help="use the same value, or run the nodes in separate processes",
                    related=(Pointer("the other value", other_path),),
                )


def _shared_process(context: Context, node: NodeWiring) -> str:
    """The process that a node shares with others; empty if it has its own."""
    if node.node.container:
        return f"{node.path[0]}.{node.node.container}"
    shared = context.spec.graph.placement != "separate" and node.path[0] == "graph"
    kind = node.node.kind
    return f" {kind.name}" if shared and node.shares_process else ""


RULE = Rule(code="R2B615", find=_find)
