"""Bounds that no value can meet together."""

from __future__ import annotations

import math

from r2bspec.check.rule_api import (
    Context,
    Finding,
    Findings,
    KnownMetric,
    Pointer,
    Rule,
    example,
    known_metrics,
    quote,
)
from r2bspec.language.requirement_grammar import Requirement


def _find(context: Context) -> Findings:
    by_key: dict[tuple[object, ...], list[KnownMetric]] = {}
    for each in known_metrics(context):
        located, bound = each.located, each.located.requirement.bound
        if bound is None or located.requirement.windows_share is not None:
            continue
        relative = (bound.of_offered, bound.of_baseline, bound.dimension)
        key = (located.role, located.at, each.monitor, each.info.name, relative)
        for other in by_key.setdefault(key, []):
            if _contradict(located.requirement, other.located.requirement):
                yield Finding(
                    message=f"{quote(located.requirement.text)} contradicts "
                    f"{quote(other.located.requirement.text)}",
                    path=located.path,
                    part=located.bound_part,
                    help="correct one of the bounds",
                    related=(Pointer("the other bound", other.located.path),),
                    suppressed_by={located.subject},
                )
                break
        by_key[key].append(each)


def _contradict(one: Requirement, other: Requirement) -> bool:
    """Whether no value meets both."""
    low = max((_lower_limit(each) for each in (one, other)), key=lambda end: (end[0], end[1]))
    high = min((_upper_limit(each) for each in (one, other)), key=lambda end: (end[0], not end[1]))
    return low[0] > high[0] or (low[0] == high[0] and (low[1] or high[1]))


def _lower_limit(requirement: Requirement) -> tuple[float, bool]:
    """The lower end of the allowed values, and whether it is excluded."""
    bound = requirement.bound
    if bound is None or requirement.op not in {">", ">=", "=="}:
        return -math.inf, False
    return bound.value, requirement.op == ">"


def _upper_limit(requirement: Requirement) -> tuple[float, bool]:
    bound = requirement.bound
    if bound is None or requirement.op not in {"<", "<=", "=="}:
        return math.inf, False
    return bound.value, requirement.op == "<"


RULE = Rule(
    code="R2B514",
    title="contradictory bounds",
    severity="error",
    why="No run can meet both bounds.",
    failing=example(
        slos="{fast: {at: 30 Hz, require: [latency.p90 < 20 ms, latency.p90 >= 50 ms]}}"
    ),
    passing=example(
        slos="{fast: {at: 30 Hz, require: [latency.p90 < 50 ms, latency.p90 >= 20 ms]}}"
    ),
    find=_find,
)
