"""Topics that the spec plays or remaps, but to which no node or monitor subscribes."""

from __future__ import annotations

from r2bspec.check.rule_api import (
    MAX_SUGGESTIONS,
    Context,
    Endpoint,
    Finding,
    Findings,
    PhaseWiring,
    Rule,
    quote,
    suggestion,
    topic_key,
)
from r2bspec.wiring.name_resolution import SHARED_TOPICS


def _find(context: Context) -> Findings:
    # R2B401, R2B403 and R2B404 cover the preprocess phase.
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
    """Whether the spec names the topic. Graphs often leave other outputs of a node unused."""
    if publisher.topic in SHARED_TOPICS:
        return False
    return publisher.owner == "player" or "remappings" in publisher.path


def _finding(
    context: Context, phase: PhaseWiring, publisher: Endpoint, subscribed: list[str]
) -> Finding:
    shown = context.relative_name(publisher.topic)
    played = publisher.owner == "player"
    return Finding(
        message=f"no subscription to {quote(shown)}, which is played"
        if played
        else f"no subscription to {quote(shown)}, to which {quote(publisher.own_name)} is remapped",
        path=publisher.path,
        key=publisher.topic_is_key,
        help=suggestion(shown, subscribed, "subscribed topics"),
        suppressed_by={topic_key(phase.phase, publisher.topic)},
    )


RULE = Rule(code="R2B208", find=_find)
