"""Preprocessors that form a cycle."""

from __future__ import annotations

from r2bspec.check.rule_api import (
    PREPROCESS_FLOW,
    Context,
    Finding,
    Findings,
    Rule,
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


RULE = Rule(code="R2B402", find=_find)
