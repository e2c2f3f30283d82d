"""Parameter values for which ROS has no type, or a plan no way to write them."""

from __future__ import annotations

import math

from r2bspec.check.parameter_types import parameter_overrides, parameter_type
from r2bspec.check.rule_api import Context, Finding, Findings, Rule, example, quote, value_key
from r2bspec.language.spec import ParameterValue


def _find(context: Context) -> Findings:
    for _, node in context.nodes:
        for each in parameter_overrides(context, node):
            problem = _problem(each.value)
            if problem:
                path = each.path
                yield Finding(
                    message=f"{quote(each.name)} of {node.key} {problem[0]}",
                    path=path,
                    help=problem[1],
                    suppresses={value_key(path)},
                )


def _problem(value: ParameterValue) -> tuple[str, str] | None:
    items = value if isinstance(value, list) else [value]
    if any(isinstance(each, float) and not math.isfinite(each) for each in items):
        return "is not a finite number, which a plan cannot hold", ""
    if any(isinstance(each, int) and not -(2**63) <= each < 2**63 for each in items):
        return "does not fit into the 64 bits of a ROS integer", ""
    if isinstance(value, list) and not value:
        return "is an empty list, of which ROS cannot tell the type", "leave the parameter out"
    if parameter_type(value) is None:
        return (
            "is a list of different types, which ROS does not have",
            "make all items integers, all doubles (1.0), all strings or all truth values",
        )
    return None


RULE = Rule(
    code="R2B213",
    title="a parameter value that ROS cannot hold",
    severity="error",
    why="A ROS parameter is a truth value, a 64-bit integer, a double, a string, or a list of "
    "items that are all of one of these types.",
    failing=example(
        graph="""
            nodes:
              relay:
                command: [sh, ./relay.sh]
                parameters: {gains: [1, 0.5]}
                subscribes: {input: sensor_msgs/msg/Image}
                publishes: {output: sensor_msgs/msg/Image}
                remappings: {input: image}
        """
    ),
    passing=example(
        graph="""
            nodes:
              relay:
                command: [sh, ./relay.sh]
                parameters: {gains: [1.0, 0.5]}
                subscribes: {input: sensor_msgs/msg/Image}
                publishes: {output: sensor_msgs/msg/Image}
                remappings: {input: image}
        """
    ),
    find=_find,
)
