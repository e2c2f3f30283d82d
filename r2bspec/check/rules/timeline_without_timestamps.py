"""Timelines with inputs that have no timestamps."""

from __future__ import annotations

from r2bspec.check.message_types import begins_with_header
from r2bspec.check.rule_api import Context, Finding, Findings, Rule, example, quote
from r2bspec.plan.topic_plans import direct_bag_topic


def _find(context: Context) -> Findings:
    playback = context.spec.playback
    if playback.mode != "timeline" or playback.record_timeline:
        return
    for name, each in playback.inputs.items():
        source = context.harness_topic(each.source)
        preprocessed = not direct_bag_topic(source, context.spec, context.wiring)
        if preprocessed and begins_with_header(each.format) is False:
            yield Finding(
                message=f"{quote(name)} has no timestamps: it is the output of a preprocessor, and "
                f"{each.format} has no header",
                path=("playback", "inputs", name),
                key=True,
                help="use 'record_timeline: true' to play the messages at the times at which the "
                "preprocessor publishes them",
            )


RULE = Rule(
    code="R2B409",
    title="input of a timeline has no timestamps",
    severity="error",
    why="A timeline plays each message at the time of its header or of its recording. The output "
    "of a preprocessor has no recorded times, so it needs a header.",
    failing=example(
        preprocessors="""
            trigger:
              command: [sh, ./trigger.sh]
              subscribes: {image_raw: sensor_msgs/msg/Image}
              publishes: {trigger_raw: std_msgs/msg/Bool}
        """,
        playback="""
            mode: timeline
            inputs:
              image: {from: image_raw, format: sensor_msgs/msg/Image}
              trigger: {from: trigger_raw, format: std_msgs/msg/Bool}
        """,
        graph="""
            nodes:
              camera:
                command: [sh, ./camera.sh]
                subscribes: {image: sensor_msgs/msg/Image, trigger: std_msgs/msg/Bool}
                publishes: {output: sensor_msgs/msg/Image}
        """,
        benchmark="{duration: 5 s}",
    ),
    passing=example(
        preprocessors="""
            trigger:
              command: [sh, ./trigger.sh]
              subscribes: {image_raw: sensor_msgs/msg/Image}
              publishes: {trigger_raw: std_msgs/msg/Bool}
        """,
        playback="""
            mode: timeline
            record_timeline: true
            inputs:
              image: {from: image_raw, format: sensor_msgs/msg/Image}
              trigger: {from: trigger_raw, format: std_msgs/msg/Bool}
        """,
        graph="""
            nodes:
              camera:
                command: [sh, ./camera.sh]
                subscribes: {image: sensor_msgs/msg/Image, trigger: std_msgs/msg/Bool}
                publishes: {output: sensor_msgs/msg/Image}
        """,
        benchmark="{duration: 5 s}",
    ),
    find=_find,
)
