"""Containers without nodes."""

from __future__ import annotations

from r2bspec.check.rule_api import Context, Finding, Findings, Rule, quote


def _find(context: Context) -> Findings:
    used = {node.node.container for _, node in context.nodes}
    for name in context.spec.containers:
        if name not in used:
            yield Finding(
                message=f"container {quote(name)} has no nodes",
                path=("containers", name),
                key=True,
                help=f"set {quote(f'container: {name}')} for a node, or remove the container",
                suppressed_by={"containers"},
            )


RULE = Rule(code="R2B218", find=_find)
