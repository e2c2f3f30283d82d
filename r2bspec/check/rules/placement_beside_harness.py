"""Nodes that share a process with the harness."""

from __future__ import annotations

from r2bspec.check.rule_api import Context, Finding, Iterator, Rule, Severity, example, quoted_list


def _find(context: Context) -> Iterator[Finding]:
    graph = context.spec.graph
    if graph.placement != "harness":
        return
    colocated = [
        node.key
        for node in context.wiring.measure.nodes
        if node.node.kind.role == "host" and not node.node.container
    ]
    if colocated:
        yield Finding(
            message=f"{quoted_list(colocated)} shares its process, and Python's lock, with player "
            "and "
            "monitors"
            if len(colocated) == 1
            else f"{quoted_list(colocated)} share one process, and Python's lock, with player "
            "and monitors",
            path=("graph", "placement"),
            help="'separate' uses one processor core for each",
        )


RULE = Rule(
    code="R2B626",
    title="nodes in the process of the harness",
    severity=Severity.INFO,
    why="It saves the way between processes, but what the harness does delays the graph, and only "
    "one of them runs at a time, however many cores there are.",
    failing=example(
        graph="""
            placement: harness
            nodes:
              relay: {python: r2bspec.nodes.RelayNode, remappings: {input: image}}
        """
    ),
    passing=example(
        graph="""
            placement: separate
            nodes:
              relay: {python: r2bspec.nodes.RelayNode, remappings: {input: image}}
        """
    ),
    find=_find,
)
