"""Metrics of requirements: whether they exist, and a run of this kind measures them."""

from __future__ import annotations

from r2bspec.check.check_context import Context
from r2bspec.check.message_types import begins_with_header
from r2bspec.check.requirement_metrics import KnownMetric
from r2bspec.check.rule import Finding, Findings, Pointer, quoted_list, rule
from r2bspec.diagnostics.quote import quote
from r2bspec.measure.metric_catalogue import TRUTHS, available_live, kind_of


@rule("R2B501")
def metric_unknown(context: Context) -> Findings:
    """Requirements on unknown metrics or monitors."""
    for unknown in context.unknown_metrics:
        error = unknown.error
        yield Finding(
            message=str(error),
            path=unknown.located.path,
            part=unknown.located.metric_part,
            help=f"did you mean {quote(error.suggestion)}?"
            if error.suggestion
            else f"known are {quoted_list(error.known)}",
            related=_declaration(error.suggestion, unknown.located.requirement.text, context),
        )


def _declaration(suggestion: str, written: str, context: Context) -> tuple[Pointer, ...]:
    """The declaration of the suggested monitor."""
    monitor = suggestion.partition(".")[0]
    if monitor not in context.spec.monitors or written.lstrip().startswith(f"{monitor}."):
        return ()
    return (Pointer(f"{quote(monitor)} is declared here", ("monitors", monitor), key=True),)


@rule("R2B503")
def metric_without_monitor(context: Context) -> Findings:
    """Metrics without a monitor name, in specs with several monitors."""
    monitors = context.spec.monitors
    for metric in context.known_metrics:
        if len(monitors) > 1 and metric.info.scope == "monitor" and metric.monitor is None:
            name = metric.info.name
            first = next(iter(monitors))
            yield Finding(
                message=f"{quote(name)} is required of every monitor: {quoted_list(monitors)}",
                path=metric.located.path,
                part=metric.located.metric_part,
                help=f"to select one monitor, write for example {quote(f'{first}.{name}')}",
            )


_PROBE_SCOPES = ("monitor", "playback")


@rule("R2B509")
def search_condition_unsupported(context: Context) -> Findings:
    """Conditions of a search that a probe does not measure."""
    for metric in context.known_metrics:
        if metric.located.role == "holds" and metric.info.scope not in _PROBE_SCOPES:
            yield Finding(
                message=f"probes of a search do not measure {quote(metric.info.name)}",
                path=metric.located.path,
                part=metric.located.metric_part,
                help="remove it: every probe checks that the backlog does not grow"
                if metric.info.scope == "probe"
                else "use a metric of a monitor, such as 'drop_rate <= 5 %'",
                suppresses={metric.located.subject},
            )


_NEED_STAMPS = frozenset({"duplicates", "reordered"})


@rule("R2B525")
def count_with_order_matching(context: Context) -> Findings:
    """Counts that need stamps, required of a monitor that matches by order."""
    monitors = context.spec.monitors
    for metric in context.known_metrics:
        if metric.info.name not in _NEED_STAMPS:
            continue
        for name in [metric.monitor] if metric.monitor else monitors:
            if monitors[name].match == "order":
                yield Finding(
                    message=f"monitor {name} matches by order, which cannot count "
                    f"{quote(metric.info.name)}",
                    path=metric.located.path,
                    part=metric.located.metric_part,
                    help="require it of a monitor that matches by stamp, or require 'missed' and "
                    "'unmatched' instead",
                    related=(Pointer("matched by order here", ("monitors", name, "match")),),
                    suppressed_by={metric.located.subject},
                )


_PROBE_STATISTICS = ("search", "sequential")
"""Statistics of the metrics that need a selectable rate."""


@rule("R2B526")
def metric_unavailable(context: Context) -> Findings:
    """Requirements on metrics that the playback mode does not provide."""
    if not context.has_own_rate:
        return
    for metric in context.known_metrics:
        problem = _why_unavailable(context, metric)
        if problem is not None:
            message, help_text = problem
            yield Finding(
                message=message,
                path=metric.located.path,
                help=help_text,
                suppressed_by={metric.located.subject},
            )


def _why_unavailable(context: Context, metric: KnownMetric) -> tuple[str, str] | None:
    """Message and help; None if the metric is available."""
    name, mode = quote(metric.info.name), context.spec.playback.mode
    bound = metric.located.requirement.bound
    if bound is not None and bound.of_offered:
        return (
            f"'mode: {mode}' has no offered rate, so the bound of {name} cannot be a share of it",
            "write the bound as a rate",
        )
    if metric.info.statistic in _PROBE_STATISTICS:
        return (
            f"{name} needs playback at several rates, which 'mode: {mode}' does not support",
            "remove it, or use 'mode: looping'",
        )
    if mode != "live":
        return None
    if not available_live(metric.info):
        return (
            f"{name} is not available with 'mode: live', which does not observe the inputs",
            "use a metric of the outputs: throughput, interval, jitter, received, latency",
        )
    if metric.info.family == "latency" and (headerless := _headerless_monitor(context, metric)):
        return (
            f"latency of monitor {headerless} is not available: its messages have no header",
            "use a metric that needs no header: throughput, interval, jitter, received",
        )
    return None


def _headerless_monitor(context: Context, metric: KnownMetric) -> str:
    """A monitor with a latency requirement whose messages are known to have no header."""
    monitors = context.spec.monitors
    monitor_names = monitors if metric.monitor is None else [metric.monitor]
    return next(
        (name for name in monitor_names if begins_with_header(monitors[name].format) is False), ""
    )


@rule("R2B533")
def accuracy_without_truth(context: Context) -> Findings:
    """Requirements on accuracy where no monitor names what its messages are compared with."""
    monitors = context.spec.monitors
    for metric in context.known_metrics:
        kind = kind_of(metric.info.name)
        if kind is None:
            continue
        names = [*monitors] if metric.monitor is None else [metric.monitor]
        if any((truth := monitors[name].truth) and truth.kind == kind for name in names):
            continue
        whose = f"monitor {metric.monitor} names" if metric.monitor else "no monitor names"
        lack = "no truth of that kind" if metric.monitor else "a truth of that kind"
        yield Finding(
            message=f"{quote(metric.info.name)} has no value: {whose} {lack}",
            path=metric.located.path,
            part=metric.located.metric_part,
            help=f"add 'truth: {{kind: {kind}, name: ...}}' to a monitor of type "
            f"{TRUTHS[kind].format}",
            suppressed_by={metric.located.subject},
        )
