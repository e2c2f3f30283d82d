"""Preprocessors that form a cycle."""

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
                    message=f"preprocessor {node.key} is in a cycle: its input "
                    f"{quote(context.relative_name(each.topic))} depends on its own output",
                    path=each.path,
                    key=each.topic_is_key,
                    help="pass messages in one direction, from the data loader to the playback "
                    "inputs",
                    suppressed_by={topic_key(phase.phase, each.topic)},
                    suppresses={PREPROCESS_FLOW},
                )


RULE = Rule(
    code="R2B402",
    title="preprocessors form a cycle",
    severity="error",
    why="Messages circulate in a cycle without end, so preprocessing never completes.",
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
