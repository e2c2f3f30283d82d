"""Remappings that an earlier one of the same topic keeps from ever being applied."""

from __future__ import annotations

from r2bspec.check.rule_api import (
    Context,
    Finding,
    Findings,
    Pointer,
    Rule,
    example,
    quote,
    topic_key,
)
from r2bspec.wiring.name_resolution import expand


def _find(context: Context) -> Findings:
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
                suppresses={topic_key(phase, expand(right, node.key, node.namespace))},
            )


RULE = Rule(
    code="R2B205",
    title="a remapping that another one shadows",
    severity="error",
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
