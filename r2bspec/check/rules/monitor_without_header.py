"""Monitors that match by stamp, of messages without a header."""

from __future__ import annotations

from r2bspec.check.message_types import begins_with_header
from r2bspec.check.rule_api import Context, Finding, Findings, Rule, example, value_key


def _find(context: Context) -> Findings:
    for name, monitor in context.spec.monitors.items():
        path = ("monitors", name)
        if monitor.match == "stamp" and begins_with_header(monitor.format) is False:
            yield Finding(
                message=f"monitor {name} matches by stamp, but {monitor.format} has no header",
                path=(*path, "format"),
                help="use 'match: order' if each input has one output",
                suppressed_by={value_key((*path, "format"))},
                suppresses={value_key((*path, "match"))},
            )


RULE = Rule(
    code="R2B406",
    title="monitor matches by stamp, but its messages have no header",
    severity="error",
    why="Matching by stamp pairs each output with the input that has the same header stamp. "
    "Without a header no output matches, and every input counts as missed.",
    failing=example(
        graph="""
            nodes:
              counter:
                command: [sh, ./counter.sh]
                subscribes: {image: sensor_msgs/msg/Image}
                publishes: {output: std_msgs/msg/Float32}
        """,
        monitors="{output: {topic: output, format: std_msgs/msg/Float32}}",
    ),
    passing=example(
        graph="""
            nodes:
              counter:
                command: [sh, ./counter.sh]
                subscribes: {image: sensor_msgs/msg/Image}
                publishes: {output: std_msgs/msg/Float32}
        """,
        monitors="{output: {topic: output, format: std_msgs/msg/Float32, match: order}}",
    ),
    find=_find,
)
