"""Remappings that an earlier one of the same topic keeps from ever being applied."""

from __future__ import annotations

from collections.abc import Iterator

from r2bspec.check import suppression_keys
from r2bspec.check.check_context import Context
from r2bspec.check.example_spec import example
from r2bspec.check.finding import Finding, Pointer
from r2bspec.check.rule import Rule
from r2bspec.diagnostics.diagnostic import Severity
from r2bspec.diagnostics.quote import quote
from r2bspec.wiring.name_resolution import expand


def _find(context: Context) -> Iterator[Finding]:
    for phase, node in context.nodes:
        first: dict[str, str] = {}
        for left, right in node.node.remappings.items():
            full = expand(left, node.key, node.namespace)
            if full not in first:
                first[full] = left
                continue
            place = (*node.path, "remappings")
            yield Finding(
                message=f"{quote(left)} and {quote(first[full])} are the same topic, {full}, "
                "remapped twice",
                path=(*place, left),
                key=True,
                help="ROS applies the first of them; remove one",
                related=(Pointer("remapped here already", (*place, first[full]), key=True),),
                suppresses=frozenset(
                    {suppression_keys.topic(phase, expand(right, node.key, node.namespace))}
                ),
            )


RULE = Rule(
    code="R2B205",
    title="a remapping that another one shadows",
    severity=Severity.ERROR,
    why="ROS applies the first remapping that matches a topic and never looks at the second.",
    failing=example(
        graph="""
            nodes:
              relay:
                python: r2bspec.nodes.RelayNode
                remappings: {input: image, /r2b/input: image_raw}
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
