"""Metrics of monitors without saying which, where there are several."""

from __future__ import annotations

from r2bspec.check.rule_api import (
    Context,
    Finding,
    Findings,
    Rule,
    example,
    known_metrics,
    quote,
    quoted_list,
)


def _find(context: Context) -> Findings:
    monitors = context.spec.monitors
    for each in known_metrics(context):
        if len(monitors) > 1 and each.info.scope == "monitor" and each.monitor is None:
            name = each.info.name
            first = next(iter(monitors))
            yield Finding(
                message=(
                    f"{quote(name)} is required of each of the monitors {quoted_list(monitors)}"
                ),
                path=each.located.path,
                part=each.located.metric_part,
                help=f"to mean one of them, write for example {quote(f'{first}.{name}')}",
            )


RULE = Rule(
    code="R2B503",
    title="a requirement on every monitor at once",
    severity="info",
    why="A metric without the name of a monitor is judged for each. That may be meant; it is said "
    "here because nothing else in the document shows it.",
    failing=example(
        monitors="""
            output: {topic: output, format: sensor_msgs/msg/Image}
            input: {topic: image, format: sensor_msgs/msg/Image}
        """,
        slos="{fast: {at: 30 Hz, require: [latency.p90 < 50 ms]}}",
    ),
    passing=example(
        monitors="""
            output: {topic: output, format: sensor_msgs/msg/Image}
            input: {topic: image, format: sensor_msgs/msg/Image}
        """,
        slos="{fast: {at: 30 Hz, require: [output.latency.p90 < 50 ms]}}",
    ),
    find=_find,
)
