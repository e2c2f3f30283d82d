"""Requirements on what no run of the mode can know."""

from __future__ import annotations

from collections.abc import Iterator

from r2bspec.check.check_context import Context
from r2bspec.check.example_spec import example
from r2bspec.check.finding import Finding
from r2bspec.check.message_types import begins_with_header
from r2bspec.check.requirement_metrics import Known, known_metrics
from r2bspec.check.rule import Rule
from r2bspec.diagnostics.diagnostic import Severity
from r2bspec.diagnostics.quote import quote
from r2bspec.measure.metric_catalogue import known_live
from r2bspec.plan.compile_plan import has_own_rate

_PROBED = ("search", "sequential")
"""How metrics are judged that need a rate to be chosen."""


def _find(context: Context) -> Iterator[Finding]:
    if not has_own_rate(context.spec):
        return
    for each in known_metrics(context):
        found = _unknown(context, each)
        if found is not None:
            message, help_text = found
            yield Finding(
                message=message,
                path=each.placed.path,
                help=help_text,
                about=frozenset({each.placed.subject}),
            )


def _unknown(context: Context, each: Known) -> tuple[str, str] | None:
    """What is wrong with a requirement, and what helps."""
    name, mode = quote(each.info.name), context.spec.playback.mode
    bound = each.placed.requirement.bound
    if bound is not None and bound.of_offered:
        return (
            f"no rate is offered with 'mode: {mode}', of which {name} could be a share",
            "write the bound as a rate",
        )
    if each.info.statistic in _PROBED:
        return (
            f"{name} is found by playing at chosen rates, and with 'mode: {mode}' there are none",
            "remove it, or write 'mode: looping'",
        )
    if mode != "live":
        return None
    if not known_live(each.info):
        return (
            f"nobody knows {name} of a live graph: what its source sends is not seen",
            "require something of what arrives: throughput, interval, jitter, received, latency",
        )
    if each.info.family == "latency" and (silent := _without_stamp(context, each)):
        return (
            f"the latency at monitor {silent} is never known: its messages have no header",
            "require something of what arrives: throughput, interval, jitter, received",
        )
    return None


def _without_stamp(context: Context, each: Known) -> str:
    """A monitor that is asked for a latency, and whose messages are known to have no header."""
    monitors = context.spec.monitors
    asked = monitors if each.monitor is None else [each.monitor]
    return next((name for name in asked if begins_with_header(monitors[name].format) is False), "")


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
