"""Topics that are published on purpose although nobody reads them."""

from __future__ import annotations

from r2bspec.check.rule_api import (
    MAX_SUGGESTIONS,
    Context,
    Endpoint,
    Finding,
    Findings,
    PhaseWiring,
    Rule,
    example,
    quote,
    suggestion,
    topic_key,
)
from r2bspec.wiring.name_resolution import SHARED_TOPICS


def _find(context: Context) -> Findings:
    # Of the preprocess phase, rules of their own look at what is loaded and what is played.
    phase = context.wiring.measure
    if phase.possible_subscribers:
        return
    subscribed = [context.relative_name(name) for name in phase.topics if phase.subscriptions(name)]
    found = 0
    for publisher in phase.endpoints:
        if (
            publisher.is_publisher
            and not phase.subscriptions(publisher.topic)
            and _is_intended(publisher)
        ):
            found += 1
            yield _finding(
                context, phase, publisher, subscribed if found <= MAX_SUGGESTIONS else []
            )


def _is_intended(publisher: Endpoint) -> bool:
    """Whether the spec makes the topic. Nodes have outputs of which a graph uses some."""
    if publisher.topic in SHARED_TOPICS:
        return False
    return publisher.owner == "player" or "remappings" in publisher.path


def _finding(
    context: Context, phase: PhaseWiring, publisher: Endpoint, subscribed: list[str]
) -> Finding:
    shown = context.relative_name(publisher.topic)
    played = publisher.owner == "player"
    return Finding(
        message=f"{quote(shown)} is played, but nobody reads it"
        if played
        else f"nobody reads {quote(shown)}, to which {quote(publisher.own_name)} is remapped",
        path=publisher.path,
        key=publisher.topic_is_key,
        help=suggestion(shown, subscribed, "topics that are read"),
        suppressed_by={topic_key(phase.phase, publisher.topic)},
    )


RULE = Rule(
    code="R2B208",
    title="a topic that nobody reads",
    severity="warning",
    why="Playing it costs time and measures nothing; a remapping that leads nowhere is often a "
    "misspelt one.",
    failing=example(
        data_loader="""
            bag: r2b_storage
            topics:
              /d455_1_rgb_image: image_raw
              /d455_1_rgb_camera_info: info_raw
        """,
        playback="""
            inputs:
              image: {from: image_raw, format: sensor_msgs/msg/Image}
              camera_info: {from: info_raw, format: sensor_msgs/msg/CameraInfo}
        """,
    ),
    passing=example(
        data_loader="""
            bag: r2b_storage
            topics:
              /d455_1_rgb_image: image_raw
        """,
        playback="""
            inputs:
              image: {from: image_raw, format: sensor_msgs/msg/Image}
        """,
    ),
    find=_find,
)
