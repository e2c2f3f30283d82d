"""Requirements on metrics that the playback mode does not provide."""

from __future__ import annotations

from r2bspec.check.message_types import begins_with_header
from r2bspec.check.rule_api import (
    Context,
    Finding,
    Findings,
    KnownMetric,
    Rule,
    known_metrics,
    quote,
)
from r2bspec.measure.metric_catalogue import available_live

_PROBE_STATISTICS = ("search", "sequential")
"""Statistics of the metrics that need a selectable rate."""


def _find(context: Context) -> Findings:
    if not context.has_own_rate:
        return
    for each in known_metrics(context):
        found = _problem(context, each)
        if found is not None:
            message, help_text = found
            yield Finding(
                message=message,
                path=each.located.path,
                help=help_text,
                suppressed_by={each.located.subject},
            )


def _problem(context: Context, each: KnownMetric) -> tuple[str, str] | None:
    """Message and help; None if the metric is available."""
    name, mode = quote(each.info.name), context.spec.playback.mode
    bound = each.located.requirement.bound
    if bound is not None and bound.of_offered:
        return (
            f"'mode: {mode}' has no offered rate, so the bound of {name} cannot be a share of it",
            "write the bound as a rate",
        )
    if each.info.statistic in _PROBE_STATISTICS:
        return (
            f"{name} needs playback at several rates, which 'mode: {mode}' does not support",
            "remove it, or use 'mode: looping'",
        )
    if mode != "live":
        return None
    if not available_live(each.info):
        return (
            f"{name} is not available with 'mode: live', which does not observe the inputs",
            "use a metric of the outputs: throughput, interval, jitter, received, latency",
        )
    if each.info.family == "latency" and (headerless := _monitor_without_header(context, each)):
        return (
            f"latency of monitor {headerless} is not available: its messages have no header",
            "use a metric that needs no header: throughput, interval, jitter, received",
        )
    return None


def _monitor_without_header(context: Context, each: KnownMetric) -> str:
    """A monitor with a latency requirement whose messages are known to have no header."""
    monitors = context.spec.monitors
    monitor_names = monitors if each.monitor is None else [each.monitor]
    return next(
        (name for name in monitor_names if begins_with_header(monitors[name].format) is False), ""
    )


RULE = Rule(code="R2B526", find=_find)
