"""Preprocessors that read what they have written."""

from __future__ import annotations

from r2bspec.check.rule_api import (
    PREPROCESS_FLOW,
    Context,
    Finding,
    Findings,
    Rule,
    example,
    quote,
    topic_key,
)


def _find(context: Context) -> Findings:
    phase = context.wiring.preprocess
    for node in phase.nodes:
        endpoints = phase.endpoints_of(node.name)
        reached = phase.downstream_of(each.topic for each in endpoints if each.is_publisher)
        for each in endpoints:
            if not each.is_publisher and each.topic in reached:
                yield Finding(
                    message=f"{node.key} reads {quote(context.relative_name(each.topic))}, to "
                    "which its "
                    "own output leads",
                    path=each.path,
                    key=each.topic_is_key,
                    help="preprocessors pass messages on from the bag to the playback inputs",
                    suppressed_by={topic_key(phase.phase, each.topic)},
                    suppresses={PREPROCESS_FLOW},
                )


RULE = Rule(
    code="R2B402",
    title="preprocessors in a circle",
    severity="error",
    why="A message in a circle of nodes is never done with, so preprocessing has no end.",
    failing=example(
        preprocessors="""
            relay:
              python: r2bspec.nodes.RelayNode
              remappings: {input: again, output: prepared}
            back:
              python: r2bspec.nodes.RelayNode
              remappings: {input: prepared, output: again}
        """,
        playback="{inputs: {image: {from: prepared, format: sensor_msgs/msg/Image}}}",
    ),
    passing=example(
        preprocessors="""
            relay:
              python: r2bspec.nodes.RelayNode
              remappings: {input: image_raw, output: again}
            back:
              python: r2bspec.nodes.RelayNode
              remappings: {input: again, output: prepared}
        """,
        playback="{inputs: {image: {from: prepared, format: sensor_msgs/msg/Image}}}",
    ),
    find=_find,
)
