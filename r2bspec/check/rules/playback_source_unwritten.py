"""Playback inputs whose messages come from nowhere."""

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
    example,
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
        shown, [context.relative_name(topic) for topic in published], "topics that there are"
    )
    if unknown:
        advice += f"; or state what {quoted_list(unknown)} publishes under 'publishes:' there"
    unsubscribed = (topic for topic in published if not phase.subscriptions(topic))
    instead = [
        topic for topic in unsubscribed if did_you_mean(shown, [context.relative_name(topic)])
    ]
    return Finding(
        message=f"neither the data loader nor a preprocessor publishes {quote(shown)}"
        if not unknown
        else f"nobody is known to publish {quote(shown)}",
        path=each.path,
        help=advice,
        related=tuple(
            Pointer(
                f"{quote(context.relative_name(topic))} is written here, and read by nobody",
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


RULE = Rule(
    code="R2B401",
    title="a playback input whose messages come from nowhere",
    severity="error",
    why="What is played is what was loaded, or what preprocessors made of it. Nothing arrives on a "
    "topic that neither of them publishes.",
    failing=example(playback="{inputs: {image: {from: image_rw, format: sensor_msgs/msg/Image}}}"),
    passing=example(playback="{inputs: {image: {from: image_raw, format: sensor_msgs/msg/Image}}}"),
    find=_find,
)
