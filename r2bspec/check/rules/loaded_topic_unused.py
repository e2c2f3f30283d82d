"""Loaded topics without a subscription."""

from __future__ import annotations

from r2bspec.check.rule_api import (
    PREPROCESS_FLOW,
    Context,
    Finding,
    Findings,
    Rule,
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
                message=f"{quote(shown)} is loaded, but no preprocessor or playback input uses it",
                path=each.path,
                help=suggestion(shown, subscribed, "topics in use"),
                suppressed_by={PREPROCESS_FLOW, topic_key(phase.phase, each.topic)},
            )


RULE = Rule(code="R2B403", find=_find)
