"""Bounds of requirements: units, contradictions and directions."""

from __future__ import annotations

import math

from r2bspec.check.check_context import Context, KnownMetric
from r2bspec.check.rule import Finding, Findings, Pointer, SeverityName, rule
from r2bspec.diagnostics.quote import quote

_EXAMPLES = {
    "time": "a time, such as 50 ms",
    "rate": "a rate, such as 30 Hz, or a share of the offered rate, such as 97 % of offered",
    "size": "a size, such as 64 MiB",
    "share": "a share, such as 2 %",
    "power": "a power, such as 15 W",
    "energy": "an energy, such as 500 mJ",
    "count": "a whole number",
}
_UNITS = {"time": "ms", "rate": "Hz", "size": "MiB", "share": "%", "power": "W", "energy": "J"}
"""The usual unit of a bound."""


@rule("R2B502")
def bound_unit_mismatch(context: Context) -> Findings:
    """Find bounds whose unit does not fit the metric."""
    for metric in context.known_metrics:
        bound = metric.requirement.bound
        if bound is not None and not metric.info.accepts(bound):
            if bound.dimension == "count" and metric.info.dimension in _UNITS:
                yield _without_unit(metric)
                continue
            written = (
                "relative to the baseline"
                if bound.of_baseline
                else "a share of the offered rate"
                if bound.of_offered
                else _noun(bound.dimension)
            )
            yield Finding(
                message=f"{quote(metric.info.name)} is {_noun(metric.info.dimension)}, but its "
                f"bound is {written}",
                path=metric.path,
                part=metric.bound_part,
                help=f"use {_EXAMPLES[metric.info.dimension]}",
                suppresses={metric.subject},
            )


def _without_unit(metric: KnownMetric) -> Finding:
    """A number where a quantity is meant: the unit is what is missing, not the number wrong."""
    requirement = metric.requirement
    written = requirement.text[requirement.bound_column :].split()[0]
    return Finding(
        message=f"the bound {written} of {quote(metric.info.name)} has no unit",
        path=metric.path,
        part=metric.bound_part,
        help=f"write {written} {_UNITS[metric.info.dimension]}",
        suppresses={metric.subject},
    )


def _noun(dimension: str) -> str:
    return _EXAMPLES[dimension].partition(",")[0]


_Limit = tuple[float, bool]
"""An end of the allowed values, and whether it is excluded."""


@rule("R2B514")
def bound_contradiction(context: Context) -> Findings:
    """Find bounds that no value can meet together."""
    before: dict[tuple[object, ...], list[tuple[KnownMetric, _Limit, _Limit]]] = {}
    for metric in context.known_metrics:
        bound = metric.requirement.bound
        if bound is None:
            continue
        relative = (bound.of_offered, bound.of_baseline, bound.dimension)
        key = (metric.role, metric.at, metric.monitor, metric.info.name, relative)
        low, high = _limits(metric.requirement.op, bound.value)
        alike = before.setdefault(key, [])
        for other, other_low, other_high in alike:
            if _is_empty(low, other_high) or _is_empty(other_low, high):
                yield Finding(
                    message=f"{quote(metric.requirement.text)} contradicts "
                    f"{quote(other.requirement.text)}",
                    path=metric.path,
                    part=metric.bound_part,
                    help="correct one of the bounds",
                    related=(Pointer("the other bound", other.path),),
                    suppressed_by={metric.subject},
                )
                break
        alike.append((metric, low, high))


@rule("R2B534")
def bound_backwards(context: Context) -> Findings:
    """Find bounds that pass a metric which got worse, or that no graph can be shown to meet."""
    for metric in context.known_metrics:
        requirement, bound = metric.requirement, metric.requirement.bound
        if bound is None:
            continue
        at_least, more_is_better = requirement.op in {">", ">="}, metric.info.metric.more_is_better
        name, written = quote(metric.info.name), f"{100 * bound.value:g} %"
        is_margin = bound.of_baseline and bound.value < _HALF
        most_hz = _most_hz(context, metric) if at_least and not bound.of_baseline else None
        _, high = _limits(requirement.op, bound.value)
        severity: SeverityName | None = None
        if bound.of_baseline and requirement.op not in {"==", "!="} and at_least != more_is_better:
            better, way = ("larger", ">= 97 %") if more_is_better else ("smaller", "<= 103 %")
            message = (
                f"{name} is better the {better} it is: this bound passes a head that got worse"
            )
            help_text = f"write '{way} of baseline', with the margin that you allow"
        elif bound.of_offered and at_least and bound.value >= 1:
            message = (
                f"{name} cannot be shown to be {written} of the offered rate: no graph delivers "
                "more than is offered"
            )
            help_text = "allow a margin, such as '>= 98 % of offered'"
        elif most_hz is not None and bound.dimension == "rate" and bound.value >= most_hz:
            message = f"no graph delivers more than the {most_hz:g} Hz that are offered"
            help_text = "write '>= 98 % of offered'"
        elif not (bound.of_baseline or bound.of_offered) and _is_empty((0.0, False), high):
            message, help_text = f"no value of {name} is below 0", "raise the bound"
        elif at_least and metric.info.metric.name in _DELAYS and not _has_upper(context, metric):
            message = f"{name} is better the smaller it is: this bound passes every late output"
            help_text = (
                f"write '< {requirement.text[requirement.bound_column :]}', or add an upper bound"
            )
            severity = "warning"
        elif is_margin:
            message, sign = f"{name} passes only if it needs {written} of what the base needs", 1
            if at_least:
                message, sign = f"{name} passes with {written} of what the base reaches", -1
            limit = f"{'>=' if at_least else '<='} {100 + 100 * sign * bound.value:g} %"
            help_text = f"for a margin of {written}, write '{limit} of baseline'"
            severity = "warning"
        else:
            continue
        yield Finding(
            message=message,
            path=metric.path,
            part=metric.bound_part,
            help=help_text,
            severity=severity,
            suppressed_by={metric.subject},
        )


_DELAYS = ("latency", "latency_from_due", "age")
"""A lower bound alone is most likely a mistake; with an upper bound, it limits a known value."""


def _has_upper(context: Context, metric: KnownMetric) -> bool:
    """Return whether any requirement limits the same metric of the same monitor from above."""
    return any(
        other.requirement.op not in {">", ">="}
        and (other.monitor, other.info.metric.name) == (metric.monitor, metric.info.metric.name)
        for other in context.known_metrics
    )


_HALF = 0.5
"""A smaller share of the baseline is most likely a margin."""


def _most_hz(context: Context, metric: KnownMetric) -> float | None:
    """Return the rate at which outputs of a throughput are offered; None if unknown."""
    if metric.info.metric.name != "throughput" or metric.at is None or not metric.at.hz:
        return None
    monitors = context.spec.monitors
    of_metric = [metric.monitor] if metric.monitor else [*monitors]
    if not all(name in monitors and monitors[name].counts_answers for name in of_metric):
        return None
    ratios = (monitors[name].ratio for name in of_metric)
    return metric.at.hz * min((ratio.outputs / ratio.inputs for ratio in ratios), default=1.0)


def _is_empty(low: _Limit, high: _Limit) -> bool:
    """Return whether no value is between two limits."""
    return low[0] > high[0] or (low[0] == high[0] and (low[1] or high[1]))


def _limits(op: str | None, value: float) -> tuple[_Limit, _Limit]:
    """Return the limits of the values that meet a bound."""
    low = (value, op == ">") if op in {">", ">=", "=="} else (-math.inf, False)
    high = (value, op == "<") if op in {"<", "<=", "=="} else (math.inf, False)
    return low, high
