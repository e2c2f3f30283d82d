"""Parameter values that ROS parameters or plans cannot represent."""

from __future__ import annotations

import math

from r2bspec.check.parameter_types import parameter_overrides, parameter_type
from r2bspec.check.rule_api import Context, Finding, Findings, Rule, quote, value_key
from r2bspec.language.spec import ParameterValue


def _find(context: Context) -> Findings:
    for _, node in context.nodes:
        for each in parameter_overrides(context, node):
            problem = _problem(each.value)
            if problem:
                path = each.path
                yield Finding(
                    message=f"parameter {quote(each.name)} of {node.key} {problem[0]}",
                    path=path,
                    help=problem[1],
                    suppresses={value_key(path)},
                )


def _problem(value: ParameterValue) -> tuple[str, str] | None:
    items = value if isinstance(value, list) else [value]
    if any(isinstance(each, float) and not math.isfinite(each) for each in items):
        return "is not a finite number; plans store finite numbers only", ""
    if any(isinstance(each, int) and not -(2**63) <= each < 2**63 for each in items):
        return "does not fit into a 64-bit ROS integer", ""
    if isinstance(value, list) and not value:
        return "is an empty list, whose type ROS cannot determine", "remove the parameter"
    if parameter_type(value) is None:
        return (
            "is a list of different types, which ROS does not support",
            "make all items integers, doubles (1.0), strings or booleans",
        )
    return None


RULE = Rule(code="R2B213", find=_find)
