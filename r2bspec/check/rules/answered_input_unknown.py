"""Monitors that answer inputs which are none, or of which they need not speak."""

from __future__ import annotations

from r2bspec.check.rule_api import Context, Finding, Findings, Rule, did_you_mean, example, quote


def _find(context: Context) -> Findings:
    spec = context.spec
    inputs = {context.harness_topic(name): name for name in spec.playback.inputs}
    for name, monitor in spec.monitors.items():
        path = ("monitors", name, "answers")
        if monitor.answers and spec.playback.mode != "timeline":
            yield Finding(
                message=f"'answers' has no use with 'mode: {spec.playback.mode}'",
                path=path,
                key=True,
                help="remove it: each step has messages of all inputs",
                severity="warning",
            )
            continue
        for index, answered in enumerate(monitor.answers):
            if context.harness_topic(answered) not in inputs:
                close = did_you_mean(answered, tuple(inputs.values()))
                yield Finding(
                    message=f"monitor {name} answers {quote(answered)}, which is no playback input",
                    path=(*path, index),
                    help=f"did you mean {quote(close)}?"
                    if close
                    else f"inputs are {', '.join(inputs.values())}",
                )


RULE = Rule(
    code="R2B414",
    title="a monitor that answers what is no input",
    severity="error",
    why="In a timeline only those steps count for a monitor that have messages of all inputs which "
    "it answers.",
    failing=example(
        playback="""
            mode: timeline
            inputs: {image: {from: image_raw, format: sensor_msgs/msg/Image}}
        """,
        monitors="{output: {topic: output, format: sensor_msgs/msg/Image, answers: [camera]}}",
        benchmark="{duration: 5 s}",
    ),
    passing=example(
        playback="""
            mode: timeline
            inputs: {image: {from: image_raw, format: sensor_msgs/msg/Image}}
        """,
        monitors="{output: {topic: output, format: sensor_msgs/msg/Image, answers: [image]}}",
        benchmark="{duration: 5 s}",
    ),
    find=_find,
)
