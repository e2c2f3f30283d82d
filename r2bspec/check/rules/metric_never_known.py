"""Requirements on what no run of the mode can know."""

from __future__ import annotations

from r2bspec.check.message_types import begins_with_header
from r2bspec.check.rule_api import (
    Context,
    Finding,
    Iterator,
    KnownMetric,
    Rule,
    Severity,
    example,
    known_metrics,
    quote,
)
from r2bspec.measure.metric_catalogue import available_live
from r2bspec.plan.compile_plan import has_own_rate

_PROBE_STATISTICS = ("search", "sequential")
"""How metrics are judged that need a rate to be chosen."""


def _find(context: Context) -> Iterator[Finding]:
    if not has_own_rate(context.spec):
        return
    for each in known_metrics(context):
        found = _problem(context, each)
        if found is not None:
            message, help_text = found
            yield Finding(
                message=message,
                path=each.located.path,
                help=help_text,
                suppressed_by=frozenset({each.located.subject}),
            )


def _problem(context: Context, each: KnownMetric) -> tuple[str, str] | None:
    """What is wrong with a requirement, and what helps."""
    name, mode = quote(each.info.name), context.spec.playback.mode
    bound = each.located.requirement.bound
    if bound is not None and bound.of_offered:
        return (
            f"no rate is offered with 'mode: {mode}', of which {name} could be a share",
            "write the bound as a rate",
        )
    if each.info.statistic in _PROBE_STATISTICS:
        return (
            f"{name} is found by playing at chosen rates, and with 'mode: {mode}' there are none",
            "remove it, or write 'mode: looping'",
        )
    if mode != "live":
        return None
    if not available_live(each.info):
        return (
            f"nobody knows {name} of a live graph: what its source sends is not seen",
            "require something of what arrives: throughput, interval, jitter, received, latency",
        )
    if each.info.family == "latency" and (headerless := _monitor_without_header(context, each)):
        return (
            f"the latency at monitor {headerless} is never known: its messages have no header",
            "require something of what arrives: throughput, interval, jitter, received",
        )
    return None


def _monitor_without_header(context: Context, each: KnownMetric) -> str:
    """A monitor that is asked for a latency, and whose messages are known to have no header."""
    monitors = context.spec.monitors
    monitor_names = monitors if each.monitor is None else [each.monitor]
    return next(
        (name for name in monitor_names if begins_with_header(monitors[name].format) is False), ""
    )


RULE = Rule(
    code="R2B526",
    title="a metric that no run of this mode can know",
    severity=Severity.ERROR,
    why="A live graph has its own source: what that sent, and so what was lost of it, is not seen, "
    "and latency is counted from the time in the header. Neither that nor a timeline is offered at "
    "a chosen rate. A requirement on something unknown can never hold.",
    failing=example(
        playback="""
            mode: timeline
            inputs: {image: {from: image_raw, format: sensor_msgs/msg/Image}}
        """,
        benchmark="{duration: 5 s}",
        slos="{steady: {require: [throughput.mean >= 97 % of offered]}}",
    ),
    passing=example(
        playback="""
            mode: timeline
            inputs: {image: {from: image_raw, format: sensor_msgs/msg/Image}}
        """,
        benchmark="{duration: 5 s}",
        slos="{steady: {require: [throughput.mean >= 29 Hz]}}",
    ),
    find=_find,
)
