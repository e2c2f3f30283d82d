"""Bounds whose unit does not fit the metric."""

from __future__ import annotations

from r2bspec.check.rule_api import (
    Context,
    Finding,
    Findings,
    KnownMetric,
    Rule,
    known_metrics,
    quote,
)

_EXAMPLES = {
    "time": "a time, such as 50 ms",
    "rate": "a rate, such as 30 Hz, or a share of the offered one, such as 97 % of offered",
    "size": "a size, such as 64 MiB",
    "share": "a share, such as 2 %",
    "count": "a whole number",
}

_UNITS = {"time": "ms", "rate": "Hz", "size": "MiB", "share": "%"}
"""The usual unit of a bound."""


def _find(context: Context) -> Findings:
    for each in known_metrics(context):
        bound = each.located.requirement.bound
        if bound is not None and not each.info.accepts(bound):
            if bound.dimension == "count" and each.info.dimension in _UNITS:
                yield _without_unit(each)
                continue
            written = (
                "relative to the baseline"
                if bound.of_baseline
                else "a share of the offered rate"
                if bound.of_offered
                else _noun(bound.dimension)
            )
            yield Finding(
                message=f"{quote(each.info.name)} is {_noun(each.info.dimension)}, but its bound "
                f"is {written}",
                path=each.located.path,
                part=each.located.bound_part,
                help=f"use {_EXAMPLES[each.info.dimension]}",
                suppresses={each.located.subject},
            )


def _without_unit(each: KnownMetric) -> Finding:
    """A number where a quantity is meant: the unit is what is missing, not the number wrong."""
    written = str(each.located.requirement.text)[each.located.requirement.bound_column :].split()[0]
    return Finding(
        message=f"the bound {written} of {quote(each.info.name)} has no unit",
        path=each.located.path,
        part=each.located.bound_part,
        help=f"write {written} {_UNITS[each.info.dimension]}",
        suppresses={each.located.subject},
    )


def _noun(dimension: str) -> str:
    return _EXAMPLES[dimension].partition(",")[0]


RULE = Rule(code="R2B502", find=_find)
