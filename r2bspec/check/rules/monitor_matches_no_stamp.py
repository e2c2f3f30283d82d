"""Monitors that match by a stamp which their messages do not have."""

from __future__ import annotations

from r2bspec.check.message_types import begins_with_header
from r2bspec.check.rule_api import Context, Finding, Findings, Rule, example, value_key


def _find(context: Context) -> Findings:
    for name, monitor in context.spec.monitors.items():
        place = ("monitors", name)
        if monitor.match == "stamp" and begins_with_header(monitor.format) is False:
            yield Finding(
                message=f"monitor {name} matches by stamp, but {monitor.format} has no header",
                path=(*place, "format"),
                help="write 'match: order', if each input has one output",
                suppressed_by={value_key((*place, "format"))},
                suppresses={value_key((*place, "match"))},
            )


RULE = Rule(
    code="R2B406",
    title="a monitor that matches by stamp messages without one",
    severity="error",
    why="An output finds its input by the header stamp that both carry. Without one, every message "
    "would count as lost.",
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
