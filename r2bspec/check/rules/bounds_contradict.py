"""Requirements that no value can meet together."""

from __future__ import annotations

import math
from collections.abc import Iterator

from r2bspec.check.check_context import Context
from r2bspec.check.example_spec import example
from r2bspec.check.finding import Finding, Pointer
from r2bspec.check.requirement_metrics import Known, known_metrics
from r2bspec.check.rule import Rule
from r2bspec.diagnostics.diagnostic import Severity
from r2bspec.diagnostics.quote import quote
from r2bspec.language.requirement_grammar import Requirement


def _find(context: Context) -> Iterator[Finding]:
    seen: dict[tuple[object, ...], list[Known]] = {}
    for each in known_metrics(context):
        placed, bound = each.placed, each.placed.requirement.bound
        if bound is None or placed.requirement.windows_share is not None:
            continue
        relative = (bound.of_offered, bound.of_baseline, bound.dimension)
        key = (placed.role, placed.at, each.monitor, each.info.name, relative)
        for other in seen.setdefault(key, []):
            if _excludes(placed.requirement, other.placed.requirement):
                yield Finding(
                    message=f"{quote(placed.requirement.text)} and "
                    f"{quote(other.placed.requirement.text)} cannot both hold",
                    path=placed.path,
                    part=placed.bound_part,
                    help="correct one of the bounds",
                    related=(Pointer("the other one", other.placed.path),),
                    about=frozenset({placed.subject}),
                )
                break
        seen[key].append(each)


def _excludes(one: Requirement, other: Requirement) -> bool:
    """Whether no value obeys both."""
    low = max((_low(each) for each in (one, other)), key=lambda end: (end[0], end[1]))
    high = min((_high(each) for each in (one, other)), key=lambda end: (end[0], not end[1]))
    return low[0] > high[0] or (low[0] == high[0] and (low[1] or high[1]))


def _low(requirement: Requirement) -> tuple[float, bool]:
    """The least value that a requirement allows, and whether it is itself left out."""
    bound = requirement.bound
    if bound is None or requirement.op not in {">", ">=", "=="}:
        return -math.inf, False
    return bound.value, requirement.op == ">"


def _high(requirement: Requirement) -> tuple[float, bool]:
    bound = requirement.bound
    if bound is None or requirement.op not in {"<", "<=", "=="}:
        return math.inf, False
    return bound.value, requirement.op == "<"


RULE = Rule(
    code="R2B514",
    title="bounds that contradict each other",
    severity=Severity.ERROR,
    why="No run can pass.",
    failing=example(
        slos="{fast: {at: 30 Hz, require: [latency.p90 < 20 ms, latency.p90 >= 50 ms]}}"
    ),
    passing=example(
        slos="{fast: {at: 30 Hz, require: [latency.p90 < 50 ms, latency.p90 >= 20 ms]}}"
    ),
    find=_find,
)
