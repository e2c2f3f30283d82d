"""Topics with several publishers."""

from __future__ import annotations

from r2bspec.check.rule_api import (
    Context,
    Endpoint,
    Finding,
    Findings,
    PhaseWiring,
    Pointer,
    Rule,
    flow_key,
    quote,
    topic_key,
)
from r2bspec.wiring.name_resolution import SHARED_TOPICS

_HARNESS_LABELS = {"loader": "the data loader", "player": "the player"}


def _find(context: Context) -> Findings:
    for phase in context.wiring.phases:
        for topic in set(phase.topics) - SHARED_TOPICS:
            publishers = phase.publishers(topic)
            for second in publishers[1:]:
                yield _finding(context, phase, publishers[0], second)


def _finding(context: Context, phase: PhaseWiring, first: Endpoint, second: Endpoint) -> Finding:
    shown = quote(context.relative_name(first.topic))
    if first.owner == second.owner:
        message = f"{_endpoint_label(first)} publishes {shown} twice"
    else:
        message = f"{_endpoint_label(first)} and {_endpoint_label(second)} both publish {shown}"
    mixed = not (first.is_node and second.is_node)
    return Finding(
        message=message,
        path=second.path,
        key=second.topic_is_key,
        help="rename one of the two topics",
        related=(Pointer("other publisher", first.path, first.topic_is_key),),
        severity="error" if mixed else None,
        suppressed_by={topic_key(phase.phase, first.topic)},
        suppresses={flow_key(phase.phase)} if mixed else set(),
    )


def _endpoint_label(endpoint: Endpoint) -> str:
    return _HARNESS_LABELS.get(endpoint.owner, endpoint.owner.rpartition("/")[2])


RULE = Rule(code="R2B209", find=_find)
