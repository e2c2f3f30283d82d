"""Remappings of a topic to itself."""

from __future__ import annotations

from r2bspec.check.rule_api import Context, Finding, Findings, Rule, example, quote
from r2bspec.wiring.name_resolution import expand


def _find(context: Context) -> Findings:
    for _, node in context.nodes:
        for left, right in node.node.remappings.items():
            full = expand(left, node.key, node.namespace)
            if full == expand(right, node.key, node.namespace):
                also = "" if left == right else f", for both are {full}"
                yield Finding(
                    message=f"{quote(left)} is remapped to itself{also}",
                    path=(*node.path, "remappings", left),
                    key=True,
                    help="leave it out",
                )


RULE = Rule(
    code="R2B206",
    title="a remapping of a topic to itself",
    severity="warning",
    why="It does nothing, and who reads it looks for what it is there for.",
    failing=example(
        graph="""
            nodes:
              relay:
                python: r2bspec.nodes.RelayNode
                remappings: {input: image, output: /r2b/output}
        """
    ),
    passing=example(
        graph="""
            nodes:
              relay:
                python: r2bspec.nodes.RelayNode
                remappings: {input: image}
        """
    ),
    find=_find,
)
