"""Nodes in the process of the harness."""

from __future__ import annotations

from r2bspec.check.rule_api import Context, Finding, Findings, Rule, quoted_list


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


RULE = Rule(code="R2B626", find=_find)
