"""Monitors that no playback input reaches."""

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
        publishers = phase.publishers(monitor.topic)
        if publishers and monitor.topic not in reached:
            yield Finding(
                message="no path from a playback input to "
                f"{quote(context.relative_name(monitor.topic))}, the topic of monitor "
                f"{monitor.monitor}",
                path=monitor.path,
                related=(
                    Pointer("published here", publishers[0].path, publishers[0].topic_is_key),
                ),
                suppressed_by=frozenset(
                    {
                        MEASURE_FLOW,
                        topic_key(phase.phase, monitor.topic),
                    },
                ),
            )


RULE = Rule(
    code="R2B405",
    title="no path from a playback input to a monitor",
    severity="error",
    why="None of the monitored messages results from an input, so they say nothing about the "
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
