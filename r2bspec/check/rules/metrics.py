"""Metrics of requirements: whether they exist, and whether a run of this kind measures them."""

from __future__ import annotations

from collections.abc import Callable

from r2bspec.bags.message_types import begins_with_header
from r2bspec.check.check_context import Context, KnownMetric
from r2bspec.check.rule import Finding, Findings, Pointer, rule
from r2bspec.diagnostics.quote import quote, quoted_list, suggestion
from r2bspec.judge.measure.metric import Metric, Outputs, Scope
from r2bspec.judge.measure.metric_catalogue import MetricError, series_with


@rule("R2B501")
def metric_unknown(context: Context) -> Findings:
    """Find requirements on unknown metrics or monitors."""
    for located in context.requirements:
        try:
            context.resolve(located)
        except MetricError as error:
            yield Finding(
                message=str(error),
                path=located.path,
                part=located.metric_part,
                help=f"did you mean {quote(error.suggestion)}?"
                if error.suggestion
                else f"known are {quoted_list(error.known)}",
                related=_declaration(error.suggestion, located.requirement.text, context),
            )


def _declaration(suggestion: str, written: str, context: Context) -> tuple[Pointer, ...]:
    """Return the declaration of the suggested monitor."""
    monitor = suggestion.partition(".")[0]
    if monitor not in context.spec.outputs or written.lstrip().startswith(f"{monitor}."):
        return ()
    section = ("playback", "calls") if monitor in context.spec.playback.calls else ("monitors",)
    return (Pointer(f"{quote(monitor)} is declared here", (*section, monitor), key=True),)


@rule("R2B509")
def search_condition_unsupported(context: Context) -> Findings:
    """Find conditions of a search that a probe does not measure."""
    for metric in context.known_metrics:
        if metric.role == "holds" and not metric.info.scope.in_probes:
            yield Finding(
                message=f"probes of a search do not measure {quote(metric.info.name)}",
                path=metric.path,
                part=metric.metric_part,
                help="remove it: every probe checks that the backlog does not grow"
                if metric.info.scope is Scope.PROBE
                else "use a metric of a monitor, such as 'drop_rate <= 5 %'",
                suppresses={metric.subject},
            )


@rule("R2B525")
def count_with_order_matching(context: Context) -> Findings:
    """Find counts that need stamps, required of a monitor that matches by order."""
    monitors = context.spec.outputs
    for metric in context.known_metrics:
        if not metric.info.metric.needs_stamp_matching:
            continue
        for name in [metric.monitor] if metric.monitor else monitors:
            if monitors[name].match == "order":
                yield Finding(
                    message=f"monitor {name} matches by order, which cannot count "
                    f"{quote(metric.info.name)}",
                    path=metric.path,
                    part=metric.metric_part,
                    help="require it of a monitor that matches by stamp, or require 'missed' and "
                    "'unmatched' instead",
                    related=(Pointer("matched by order here", ("monitors", name, "match")),),
                    suppressed_by={metric.subject},
                )


@rule("R2B527")
def metric_unobserved(context: Context) -> Findings:
    """Find requirements on nodes and topics that are not observed from inside, or unknown nodes."""
    observed = context.spec.benchmark.anatomy
    nodes = {*context.spec.graph.nodes, *context.spec.containers}
    for index, name in enumerate(observed if isinstance(observed, tuple) else ()):
        if name not in nodes:
            yield Finding(
                message=f"{quote(name)} is not a node that can be observed",
                path=("benchmark", "anatomy", index),
                help=suggestion(name, nodes, "nodes and containers"),
            )
    for metric in context.known_metrics:
        if metric.info.scope is not Scope.ANATOMY or observed is True:
            continue
        subject = metric.info.subject
        is_part = metric.info.metric.of_one_node and bool(observed)
        if is_part and {subject, _container(context, subject)} & {*(observed or ())}:
            continue
        yield Finding(
            message=f"{quote(metric.info.name)} is only known if a run observes "
            f"{f'the process of {subject}' if is_part else 'its processes'} from inside",
            path=metric.path,
            part=metric.metric_part,
            help=f"add {subject} to 'anatomy' of 'benchmark'"
            if is_part
            else "add 'anatomy: true' to 'benchmark'",
            suppresses={metric.subject},
        )


def _container(context: Context, name: str) -> str:
    node = context.spec.graph.nodes.get(name)
    return node.container if node is not None else ""


_PROBE_STATISTICS = ("search", "sequential")
"""Statistics of the metrics that need a selectable rate."""


@rule("R2B526")
def metric_unavailable(context: Context) -> Findings:
    """Find requirements on metrics that the playback mode or the monitor does not provide."""
    for metric in context.known_metrics:
        problem = _why_unavailable_at_monitor(context, metric)
        if problem is None and context.spec.has_own_rate:
            problem = _why_unavailable(context, metric)
        if problem is not None:
            message, help_text = problem
            yield Finding(
                message=message,
                path=metric.path,
                help=help_text,
                suppressed_by={metric.subject},
            )


def _why_unavailable_at_monitor(context: Context, metric: KnownMetric) -> tuple[str, str] | None:
    """Message and help; None if the metric is known of the outputs of its monitors."""
    name = quote(metric.info.name)
    monitors = context.spec.monitors
    uncounted: dict[str, Outputs] = {
        each: "own pace" if monitor.own_pace else "any"
        for each, monitor in monitors.items()
        if not monitor.counts_answers
    }
    if metric.info.scope is Scope.PROBE and uncounted and len(uncounted) == len(monitors):
        return (
            f"{name} needs a known number of outputs for each input, which no monitor has",
            "add a monitor that matches by stamp or by order",
        )
    # Answers of calls are counted.
    named = [metric.monitor] if metric.monitor else uncounted
    found = next((each for each in named if each in uncounted), None)
    if metric.info.scope is not Scope.MONITOR or found is None:
        return None
    kind = uncounted[found]
    bound = metric.requirement.bound
    if bound is not None and bound.of_offered:
        free = "has outputs that no input triggers"
        why = free if kind == "own pace" else "may have any number of outputs"
        return (
            f"monitor {found} {why}: {name} cannot be 'of offered'",
            "write the bound as a rate",
        )
    if not metric.info.metric.known_of(kind):
        why = "whose outputs answer no input"
        if kind == "any":
            why = "which expects no number of outputs"
        return (
            f"{name} is not available at monitor {found}, {why}",
            f"use {_listed(lambda metric: metric.known_of(kind))}, or name another monitor",
        )
    return None


def _why_unavailable(context: Context, metric: KnownMetric) -> tuple[str, str] | None:
    """Message and help; None if the metric is available."""
    name, mode = quote(metric.info.name), context.spec.playback.mode
    bound = metric.requirement.bound
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
    if not metric.info.metric.live:
        return (
            f"{name} is not available with 'mode: live', which does not observe the inputs",
            f"use a metric of the outputs: {_listed(lambda metric: metric.live)}",
        )
    if metric.info.metric.of_stamps and (headerless := _headerless_monitor(context, metric)):
        without = _listed(lambda metric: metric.live and not metric.of_stamps)
        return (
            f"{name} of monitor {headerless} is not available: its messages have no header",
            f"use a metric that needs no header: {without}",
        )
    return None


def _listed(has: Callable[[Metric], bool]) -> str:
    return ", ".join(series_with(has))


def _headerless_monitor(context: Context, metric: KnownMetric) -> str:
    """Return a monitor with a latency requirement whose messages are known to have no header."""
    monitors = context.spec.outputs
    monitor_names = monitors if metric.monitor is None else [metric.monitor]
    return next(
        (name for name in monitor_names if begins_with_header(monitors[name].format) is False), ""
    )
