"""Monitors that nothing of what is played can reach."""

from __future__ import annotations

from r2bspec.check.rule_api import (
    MEASURE_FLOW,
    Context,
    Finding,
    Findings,
    Pointer,
    Rule,
    example,
    quote,
    topic_key,
)


def _find(context: Context) -> Findings:
    phase = context.wiring.measure
    if context.spec.live or phase.possible_subscribers or phase.possible_publishers:
        return
    reached = phase.downstream_of(each.topic for each in phase.endpoints_of("player"))
    for monitor in phase.endpoints_of("monitor"):
        writers = phase.publishers(monitor.topic)
        if writers and monitor.topic not in reached:
            yield Finding(
                message="no playback input leads to "
                f"{quote(context.relative_name(monitor.topic))}, which "
                f"monitor {monitor.monitor} watches",
                path=monitor.path,
                related=(Pointer("who publishes it", writers[0].path, writers[0].topic_is_key),),
                suppressed_by=frozenset(
                    {
                        MEASURE_FLOW,
                        topic_key(phase.phase, monitor.topic),
                    },
                ),
            )


RULE = Rule(
    code="R2B405",
    title="a monitor that nothing played can reach",
    severity="error",
    why="None of its messages answers an input, so nothing of what it sees says anything about the "
    "graph under test.",
    failing=example(
        graph="""
            nodes:
              relay: {python: r2bspec.nodes.RelayNode, remappings: {input: image}}
              ring: {python: r2bspec.nodes.RelayNode, remappings: {input: a, output: b}}
              back: {python: r2bspec.nodes.RelayNode, remappings: {input: b, output: a}}
        """,
        monitors="""
            output: {topic: output, format: sensor_msgs/msg/Image}
            other: {topic: a, format: sensor_msgs/msg/Image}
        """,
    ),
    passing=example(
        graph="""
            nodes:
              relay: {python: r2bspec.nodes.RelayNode, remappings: {input: image}}
              next: {python: r2bspec.nodes.RelayNode, remappings: {input: output, output: a}}
        """,
        monitors="""
            output: {topic: output, format: sensor_msgs/msg/Image}
            other: {topic: a, format: sensor_msgs/msg/Image}
        """,
    ),
    find=_find,
)
