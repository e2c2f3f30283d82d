"""Topics whose publishers and subscriptions have different types."""

from __future__ import annotations

from r2bspec.check.certainty import with_endpoint_records
from r2bspec.check.rule_api import (
    Context,
    Endpoint,
    Finding,
    Findings,
    Path,
    PhaseWiring,
    Pointer,
    Rule,
    flow_key,
    quote,
    topic_key,
    value_key,
)


def _find(context: Context) -> Findings:
    reported: set[Path] = set()
    confirmed = _confirmed(context)
    for phase in context.wiring.phases:
        for topic in phase.topics:
            typed = sorted(
                (
                    each
                    for each in (*phase.publishers(topic), *phase.subscriptions(topic))
                    if each.type
                ),
                key=lambda each: 0 if each.type_path in confirmed else _uncertainty(each),
            )
            for each in typed[1:]:
                place = each.type_path or each.path
                if each.type != typed[0].type and place not in reported:
                    reported.add(place)
                    finding = _finding(context, phase, typed[0], each)
                    yield with_endpoint_records(context, phase, finding, typed[0], each)


def _confirmed(context: Context) -> set[Path]:
    """The paths of formats of playback inputs that equal the type of the bag or preprocessor."""
    phase = context.wiring.preprocess
    return {
        each.type_path
        for each in phase.endpoints_of("recorder")
        if any(publisher.type == each.type for publisher in phase.publishers(each.topic))
    }


def _uncertainty(endpoint: Endpoint) -> int:
    """Rank of an endpoint's type: the bag is certain, a format is only stated."""
    if endpoint.owner == "loader":
        return 0
    if not endpoint.is_node:
        return 3
    return 2 if endpoint.type_path or endpoint.type_parameter else 1


def _finding(context: Context, phase: PhaseWiring, trusted: Endpoint, wrong: Endpoint) -> Finding:
    topic = quote(context.relative_name(trusted.topic))
    place = wrong.type_path or wrong.path
    if trusted.owner == "loader":
        bag_topic = trusted.path[-1]
        fact = f"{bag_topic} in the bag is {trusted.type}"
        related = Pointer(f"loaded as {topic} here", trusted.path)
    else:
        fact = f"{_endpoint_label(trusted)} {_verb(trusted)} {topic} as {trusted.type}"
        related = Pointer(
            "publisher" if trusted.is_publisher else "subscription",
            trusted.type_path or trusted.path,
            trusted.topic_is_key and not trusted.type_path,
        )
    return Finding(
        message=f"{_mismatch_text(wrong, topic)}, but {fact}",
        path=place,
        key=wrong.topic_is_key and not wrong.type_path,
        help=_help(trusted, wrong),
        related=(related,),
        suppressed_by={topic_key(phase.phase, trusted.topic), value_key(place)},
        suppresses={flow_key(phase.phase), value_key(place)},
    )


def _mismatch_text(wrong: Endpoint, topic: str) -> str:
    if wrong.is_node:
        return f"{_endpoint_label(wrong)} {_verb(wrong)} {topic} as {wrong.type}"
    return f"the format of {topic} is {wrong.type}"


def _help(trusted: Endpoint, wrong: Endpoint) -> str:
    if wrong.type_parameter:
        return f"set its parameter {quote(wrong.type_parameter)} to {trusted.type}"
    return "" if wrong.is_node else f"write {trusted.type}, or use another topic"


def _endpoint_label(endpoint: Endpoint) -> str:
    if endpoint.monitor:
        return f"monitor {endpoint.monitor}"
    if endpoint.is_node:
        return endpoint.owner.rpartition("/")[2]
    return f"the {endpoint.owner}"


def _verb(endpoint: Endpoint) -> str:
    return "publishes" if endpoint.is_publisher else "subscribes to"


RULE = Rule(code="R2B210", find=_find)
