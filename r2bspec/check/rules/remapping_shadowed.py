"""Remappings that have no effect because an earlier one matches the same topic."""

from __future__ import annotations

from r2bspec.check.rule_api import (
    Context,
    Finding,
    Findings,
    Pointer,
    Rule,
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
                message=f"{quote(left)} and {quote(first[full])} remap the same topic, {full}",
                path=(*place, left),
                key=True,
                help="remove one of them; ROS applies only the first",
                related=(Pointer("first remapping of the topic", (*place, first[full]), key=True),),
                suppresses={topic_key(phase, expand(right, node.key, node.namespace))},
            )


RULE = Rule(code="R2B205", find=_find)
