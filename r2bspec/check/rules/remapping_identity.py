"""Remappings of a topic to itself."""

from __future__ import annotations

from r2bspec.check.rule_api import Context, Finding, Findings, Rule, quote
from r2bspec.wiring.name_resolution import expand


def _find(context: Context) -> Findings:
    for _, node in context.nodes:
        for left, right in node.node.remappings.items():
            full = expand(left, node.key, node.namespace)
            if full == expand(right, node.key, node.namespace):
                also = "" if left == right else f": both names resolve to {full}"
                yield Finding(
                    message=f"{quote(left)} is remapped to itself{also}",
                    path=(*node.path, "remappings", left),
                    key=True,
                    help="remove the remapping",
                )


RULE = Rule(code="R2B206", find=_find)
