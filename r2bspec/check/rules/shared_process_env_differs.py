"""Nodes in one process that want different values of an environment variable."""

from __future__ import annotations

from r2bspec.check.rule_api import (
    Context,
    Finding,
    Iterator,
    NodeWiring,
    Path,
    Pointer,
    Rule,
    Severity,
    example,
)


def _find(context: Context) -> Iterator[Finding]:
    first: dict[tuple[str, str], tuple[str, Path]] = {}
    for _, node in context.nodes:
        process = _shared_process(context, node)
        for name, value in node.node.env.items() if process else ():
            path = (*node.path, "env", name)
            wanted, before = first.setdefault((process, name), (value, path))
            if wanted != value:
                yield Finding(
                    message=f"two nodes of one process want different values of {name}",
                    path=path,
                    help="give each a process of its own, or the same value to both",
                    related=(Pointer("the other value", before),),
                )


def _shared_process(context: Context, node: NodeWiring) -> str:
    """The process that a node shares with others; empty if it has one of its own."""
    if node.node.container:
        return f"{node.path[0]}.{node.node.container}"
    shared = context.spec.graph.placement != "separate" and node.path[0] == "graph"
    kind = node.node.kind
    return f" {kind.name}" if shared and kind.shares_process else ""


RULE = Rule(
    code="R2B615",
    title="two values of an environment variable in one process",
    severity=Severity.ERROR,
    why="Nodes of one container, and with 'placement: shared' all Python nodes, run in one "
    "process, and a process has one environment.",
    failing=example(
        graph="""
            placement: shared
            nodes:
              relay:
                python: r2bspec.nodes.RelayNode
                remappings: {input: image, output: relayed}
                env: {OMP_NUM_THREADS: "1"}
              next:
                python: r2bspec.nodes.RelayNode
                remappings: {input: relayed}
                env: {OMP_NUM_THREADS: "4"}
        """
    ),
    passing=example(
        graph="""
            placement: separate
            nodes:
              relay:
                python: r2bspec.nodes.RelayNode
                remappings: {input: image, output: relayed}
                env: {OMP_NUM_THREADS: "1"}
              next:
                python: r2bspec.nodes.RelayNode
                remappings: {input: relayed}
                env: {OMP_NUM_THREADS: "4"}
        """
    ),
    find=_find,
)
