"""Playback inputs whose source topic has no publisher."""

from __future__ import annotations

from r2bspec.check.rule_api import (
    PREPROCESS_FLOW,
    Context,
    Endpoint,
    Finding,
    Findings,
    PhaseWiring,
    Pointer,
    Rule,
    did_you_mean,
    quote,
    quoted_list,
    suggestion,
    topic_key,
    value_key,
)


def _find(context: Context) -> Findings:
    phase = context.wiring.preprocess
    for each in phase.endpoints_of("recorder"):
        if not phase.publishers(each.topic):
            yield _finding(context, phase, each)


def _finding(context: Context, phase: PhaseWiring, each: Endpoint) -> Finding:
    shown = context.relative_name(each.topic)
    unknown = [node.key for node in phase.possible_publishers]
    published = [topic for topic in phase.topics if phase.publishers(topic)]
    advice = suggestion(
        shown, [context.relative_name(topic) for topic in published], "published topics"
    )
    if unknown:
        declaration = f"list the topics of {quoted_list(unknown)} under 'publishes:'"
        advice = f"{advice}; or {declaration}" if advice else declaration
    unsubscribed = (topic for topic in published if not phase.subscriptions(topic))
    instead = [
        topic for topic in unsubscribed if did_you_mean(shown, [context.relative_name(topic)])
    ]
    return Finding(
        message=f"no publisher on {quote(shown)}: neither the data loader nor a preprocessor "
        "publishes it"
        if not unknown
        else f"no known publisher on {quote(shown)}",
        path=each.path,
        help=advice,
        related=tuple(
            Pointer(
                f"{quote(context.relative_name(topic))} is published here and has no subscription",
                publisher.path,
            )
            for topic in instead
            for publisher in phase.publishers(topic)[:1]
        ),
        severity="warning" if unknown else None,
        suppressed_by={topic_key(phase.phase, each.topic)}
        | {value_key(node.path) for node in phase.possible_publishers},
        suppresses=frozenset(
            {PREPROCESS_FLOW} | {topic_key(phase.phase, topic) for topic in instead}
        ),
    )


RULE = Rule(code="R2B401", find=_find)
