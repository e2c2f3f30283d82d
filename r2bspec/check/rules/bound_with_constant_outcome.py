"""Bounds that every value meets, or none."""

from __future__ import annotations

import math

from r2bspec.check.rule_api import (
    Context,
    Finding,
    Findings,
    KnownMetric,
    Rule,
    known_metrics,
    quote,
)

_SIGNED = frozenset({"latency", "latency_from_due"})


def _find(context: Context) -> Findings:
    for each in known_metrics(context):
        requirement = each.located.requirement
        if requirement.bound is None or requirement.bound.of_baseline:
            continue
        outcome = _constant_outcome(each)
        if outcome is not None:
            yield Finding(
                message=f"{quote(requirement.text)} always passes"
                if outcome
                else f"{quote(requirement.text)} never passes",
                path=each.located.path,
                part=each.located.bound_part,
                help=f"{quote(each.info.name)} is between 0 % and 100 %"
                if each.info.name == "drop_rate"
                else f"{quote(each.info.name)} is never below 0",
                severity="warning" if outcome else "error",
                suppressed_by={each.located.subject},
            )


def _bound_value(each: KnownMetric) -> float:
    bound = each.located.requirement.bound
    return 0.0 if bound is None else bound.value


def _constant_outcome(each: KnownMetric) -> bool | None:
    """The outcome of every run; None if it depends on the run."""
    if each.info.family in _SIGNED and each.info.statistic == "mean":
        return None
    op, value = each.located.requirement.op, _bound_value(each)
    # The CPU share of several cores adds up to more than 100 %.
    max_value = 1.0 if each.info.name == "drop_rate" else math.inf
    if (op == ">=" and value <= 0) or (op == ">" and value < 0):
        return True
    if (op == "<=" and value >= max_value) or (op == "<" and value > max_value):
        return True
    if (op == "<" and value <= 0) or (op in {"<=", "=="} and value < 0):
        return False
    if (op == ">" and value >= max_value) or (op in {">=", "=="} and value > max_value):
        return False
    return None


RULE = Rule(code="R2B515", find=_find)
