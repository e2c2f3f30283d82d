"""Nodes in the process of the harness."""

from __future__ import annotations

from r2bspec.check.rule_api import Context, Finding, Findings, Rule, example, quoted_list


def _find(context: Context) -> Findings:
    graph = context.spec.graph
    if graph.placement != "harness":
        return
    colocated = [
        node.key
        for node in context.wiring.measure.nodes
        if node.role == "host" and node.shares_process and not node.node.container
    ]
    if colocated:
        yield Finding(
            message=f"{quoted_list(colocated)} share{'s' if len(colocated) == 1 else ''} one "
            "process, and the GIL of Python, with player and monitors",
            path=("graph", "placement"),
            help="use 'placement: separate' to run each node in its own process",
        )


RULE = Rule(
    code="R2B626",
    title="nodes run in the process of the harness",
    severity="info",
    why="Messages need not be sent between processes, but the harness delays the graph: only one "
    "of them runs at a time, on any number of cores.",
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
