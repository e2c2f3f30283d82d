"""Monitors that match by stamp, where no playback input has one."""

from __future__ import annotations

from r2bspec.check.message_types import begins_with_header
from r2bspec.check.rule_api import Context, Finding, Findings, Pointer, Rule, example, value_key


def _find(context: Context) -> Findings:
    inputs = context.spec.playback.inputs
    if not inputs or any(
        each.timestamp == "header" and begins_with_header(each.format) is not False
        for each in inputs.values()
    ):
        return
    first = next(iter(inputs))
    for name, monitor in context.spec.monitors.items():
        if monitor.match == "stamp":
            yield Finding(
                message=f"monitor {name} matches by stamp, but the player stamps no playback input",
                path=("monitors", name),
                key=True,
                help="use 'match: order' if each input has one output",
                related=(
                    Pointer(
                        f"{inputs[first].format} has no header"
                        if inputs[first].timestamp == "header"
                        else "its recorded stamp is kept",
                        (
                            *("playback", "inputs", first),
                            "format" if inputs[first].timestamp == "header" else "timestamp",
                        ),
                    ),
                ),
                suppressed_by={value_key(("monitors", name, "match"))},
            )


RULE = Rule(
    code="R2B407",
    title="monitor matches by stamp, but no playback input is stamped",
    severity="error",
    why="The player writes a unique stamp into the header of each message. Outputs of inputs "
    "without such a stamp cannot be matched by it.",
    failing=example(
        graph="""
            nodes:
              camera:
                command: [sh, ./camera.sh]
                subscribes: {trigger: std_msgs/msg/Bool}
                publishes: {output: sensor_msgs/msg/Image}
        """,
        preprocessors="""
            trigger:
              command: [sh, ./trigger.sh]
              subscribes: {image_raw: sensor_msgs/msg/Image}
              publishes: {trigger_raw: std_msgs/msg/Bool}
        """,
        playback="{inputs: {trigger: {from: trigger_raw, format: std_msgs/msg/Bool}}}",
    ),
    passing=example(
        graph="""
            nodes:
              camera:
                command: [sh, ./camera.sh]
                subscribes: {image: sensor_msgs/msg/Image}
                publishes: {output: sensor_msgs/msg/Image}
        """,
    ),
    find=_find,
)
