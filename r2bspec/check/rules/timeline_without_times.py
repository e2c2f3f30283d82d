"""Timelines of messages of which nobody knows when they came to be."""

from __future__ import annotations

from r2bspec.check.message_types import begins_with_header
from r2bspec.check.rule_api import Context, Finding, Iterator, Rule, Severity, example, quote
from r2bspec.plan.topic_plans import direct_bag_topic
from r2bspec.wiring.build_wiring import harness_topic


def _find(context: Context) -> Iterator[Finding]:
    playback = context.spec.playback
    if playback.mode != "timeline" or playback.record_timeline:
        return
    for name, each in playback.inputs.items():
        source = harness_topic(each.source, context.wiring.namespace)
        made = not direct_bag_topic(source, context.spec, context.wiring)
        if made and begins_with_header(each.format) is False:
            yield Finding(
                message=f"{quote(name)} has no times: {each.format} has no header, and its "
                "messages come out of a preprocessor",
                path=("playback", "inputs", name),
                key=True,
                help="write 'record_timeline: true', to play them at the times at which they come "
                "out of it",
            )


RULE = Rule(
    code="R2B409",
    title="a timeline without times",
    severity=Severity.ERROR,
    why="A message of a timeline is played when its header, or the recording, says. What a "
    "preprocessor makes has only the first.",
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
