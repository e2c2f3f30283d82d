"""Monitors that watch the same."""

from __future__ import annotations

from r2bspec.check.rule_api import Context, Finding, Findings, Pointer, Rule, example


def _find(context: Context) -> Findings:
    first: dict[tuple[str, str], str] = {}
    for name, monitor in context.spec.monitors.items():
        topic = context.harness_topic(monitor.topic)
        other = first.setdefault((topic, monitor.match), name)
        if other != name:
            yield Finding(
                message=f"the monitors {other} and {name} watch the same topic in the same way",
                path=("monitors", name, "topic"),
                help="remove one",
                related=(Pointer("watched here already", ("monitors", other, "topic")),),
            )


RULE = Rule(
    code="R2B411",
    title="a topic that is watched twice",
    severity="warning",
    why="Each monitor takes time from the machine, and the second tells nothing new.",
    failing=example(
        monitors="""
            output: {topic: output, format: sensor_msgs/msg/Image}
            again: {topic: /r2b/output, format: sensor_msgs/msg/Image}
        """
    ),
    passing=example(
        monitors="""
            output: {topic: output, format: sensor_msgs/msg/Image}
            input: {topic: image, format: sensor_msgs/msg/Image}
        """
    ),
    find=_find,
)
