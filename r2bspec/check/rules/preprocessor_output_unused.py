"""Preprocessors whose output is not played."""

from __future__ import annotations

from r2bspec.check.rule_api import (
    PREPROCESS_FLOW,
    Context,
    Finding,
    Findings,
    Rule,
    quoted_list,
    topic_key,
)


def _find(context: Context) -> Findings:
    phase = context.wiring.preprocess
    recorded = {each.topic for each in phase.endpoints_of("recorder")}
    if phase.possible_subscribers:
        return
    for node in phase.nodes:
        if node.interface.publishes is None:
            continue
        published = [each.topic for each in phase.endpoints_of(node.name) if each.is_publisher]
        if not phase.downstream_of(published) & recorded:
            yield Finding(
                message=f"no playback input uses the output of {node.key}",
                path=node.path,
                key=True,
                help=(
                    "it publishes "
                    f"{quoted_list(context.relative_name(topic) for topic in published)}"
                ),
                suppressed_by={
                    PREPROCESS_FLOW,
                    *(topic_key(phase.phase, topic) for topic in published),
                },
            )


RULE = Rule(code="R2B404", find=_find)
