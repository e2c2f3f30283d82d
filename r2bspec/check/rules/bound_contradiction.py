"""Bounds that no value can meet together."""

from __future__ import annotations

import math
from bisect import bisect_left

import msgspec

from r2bspec.check.rule_api import (
    Context,
    Finding,
    Findings,
    KnownMetric,
    Pointer,
    Rule,
    known_metrics,
    quote,
)
from r2bspec.language.requirement_grammar import Requirement

_Limit = tuple[float, bool]
"""An end of the allowed values, and whether it is excluded."""


class _EarlierBounds(msgspec.Struct):
    """The bounds of one metric so far; of each side those that are tighter than all before them.

    They get tighter along the list, so bisection finds the first that contradicts a new bound:
    comparing all pairs of some thousand requirements takes minutes.
    """

    lower: list[tuple[_Limit, int, KnownMetric]] = msgspec.field(default_factory=list)
    upper: list[tuple[_Limit, int, KnownMetric]] = msgspec.field(default_factory=list)

    def first_contradiction(self, requirement: Requirement) -> KnownMetric | None:
        """The first bound that no value meets together with that of the requirement."""
        low, high = _lower_limit(requirement), _upper_limit(requirement)
        above = bisect_left(self.lower, True, key=lambda one: _is_empty(one[0], high))
        below = bisect_left(self.upper, True, key=lambda one: _is_empty(low, one[0]))
        found = [*self.lower[above : above + 1], *self.upper[below : below + 1]]
        return min(found, key=lambda one: one[1])[2] if found else None

    def add(self, position: int, each: KnownMetric) -> None:
        """Keep the limits of a bound that are tighter than all before them."""
        requirement = each.located.requirement
        low, high = _lower_limit(requirement), _upper_limit(requirement)
        if not self.lower or low > self.lower[-1][0]:
            self.lower.append((low, position, each))
        if not self.upper or (-high[0], high[1]) > (-self.upper[-1][0][0], self.upper[-1][0][1]):
            self.upper.append((high, position, each))


def _find(context: Context) -> Findings:
    by_key: dict[tuple[object, ...], _EarlierBounds] = {}
    for position, each in enumerate(known_metrics(context)):
        located, bound = each.located, each.located.requirement.bound
        if bound is None or located.requirement.windows_share is not None:
            continue
        relative = (bound.of_offered, bound.of_baseline, bound.dimension)
        key = (located.role, located.at, each.monitor, each.info.name, relative)
        earlier = by_key.setdefault(key, _EarlierBounds())
        other = earlier.first_contradiction(located.requirement)
        if other is not None:
            yield Finding(
                message=f"{quote(located.requirement.text)} contradicts "
                f"{quote(other.located.requirement.text)}",
                path=located.path,
                part=located.bound_part,
                help="correct one of the bounds",
                related=(Pointer("the other bound", other.located.path),),
                suppressed_by={located.subject},
            )
        earlier.add(position, each)


def _is_empty(low: _Limit, high: _Limit) -> bool:
    """Whether no value is between two limits."""
    return low[0] > high[0] or (low[0] == high[0] and (low[1] or high[1]))


def _lower_limit(requirement: Requirement) -> _Limit:
    bound = requirement.bound
    if bound is None or requirement.op not in {">", ">=", "=="}:
        return -math.inf, False
    return bound.value, requirement.op == ">"


def _upper_limit(requirement: Requirement) -> _Limit:
    bound = requirement.bound
    if bound is None or requirement.op not in {"<", "<=", "=="}:
        return math.inf, False
    return bound.value, requirement.op == "<"


RULE = Rule(code="R2B514", find=_find)
