"""Topics that are loaded although nobody uses them."""

from __future__ import annotations

from r2bspec.check.rule_api import (
    PREPROCESS_FLOW,
    Context,
    Finding,
    Findings,
    Rule,
    example,
    quote,
    suggestion,
    topic_key,
)


def _find(context: Context) -> Findings:
    phase = context.wiring.preprocess
    if phase.possible_subscribers:
        return
    subscribed = [
        context.relative_name(topic) for topic in phase.topics if phase.subscriptions(topic)
    ]
    for each in phase.endpoints_of("loader"):
        if not phase.subscriptions(each.topic):
            shown = context.relative_name(each.topic)
            yield Finding(
                message=f"{quote(shown)} is loaded, but neither a preprocessor nor a playback "
                "input reads it",
                path=each.path,
                help=suggestion(shown, subscribed, "topics that are read"),
                suppressed_by={PREPROCESS_FLOW, topic_key(phase.phase, each.topic)},
            )


RULE = Rule(
    code="R2B403",
    title="a loaded topic that nobody uses",
    severity="warning",
    why="Loading it costs time and memory, and often its name is a misspelt one.",
    failing=example(
        data_loader="""
            bag: r2b_storage
            topics:
              /d455_1_rgb_image: image_raw
              /d455_1_depth: depth_raw
        """
    ),
    passing=example(
        data_loader="""
            bag: r2b_storage
            topics:
              /d455_1_rgb_image: image_raw
        """
    ),
    find=_find,
)
