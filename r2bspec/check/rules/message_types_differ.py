"""Topics of which writers and readers state different types."""

from __future__ import annotations

from collections.abc import Iterator

from r2bspec.check import suppression_keys
from r2bspec.check.check_context import Context
from r2bspec.check.example_spec import example
from r2bspec.check.finding import Finding, Pointer
from r2bspec.check.rule import Rule
from r2bspec.diagnostics.diagnostic import Path, Severity
from r2bspec.diagnostics.quote import quote
from r2bspec.wiring.wiring import Endpoint, PhaseWiring


def _find(context: Context) -> Iterator[Finding]:
    told: set[Path] = set()
    confirmed = _confirmed(context)
    for phase in context.wiring.phases:
        for topic in phase.topics:
            typed = sorted(
                (each for each in (*phase.writers(topic), *phase.readers(topic)) if each.type),
                key=lambda each: 0 if each.type_path in confirmed else _doubt(each),
            )
            for each in typed[1:]:
                place = each.type_path or each.path
                if each.type != typed[0].type and place not in told:
                    told.add(place)
                    yield _finding(context, phase, typed[0], each)


def _confirmed(context: Context) -> set[Path]:
    """The places of those formats of playback inputs that the bag or a preprocessor agrees with."""
    phase = context.wiring.preprocess
    return {
        each.type_path
        for each in phase.owned_by("recorder")
        if any(writer.type == each.type for writer in phase.writers(each.topic))
    }


def _doubt(endpoint: Endpoint) -> int:
    """How much an endpoint's type is open to doubt: the bag knows, a format is but stated."""
    if endpoint.owner == "loader":
        return 0
    if not endpoint.is_node:
        return 3
    return 2 if endpoint.type_path or endpoint.type_parameter else 1


def _finding(context: Context, phase: PhaseWiring, sure: Endpoint, wrong: Endpoint) -> Finding:
    topic = quote(context.shown(sure.topic))
    place = wrong.type_path or wrong.path
    if sure.owner == "loader":
        bag_topic = sure.path[-1]
        fact = f"{bag_topic} in the bag is {sure.type}"
        related = Pointer(f"loaded as {topic} here", sure.path)
    else:
        fact = f"{_who(sure)} {_does(sure)} {topic} as {sure.type}"
        related = Pointer(
            "see here", sure.type_path or sure.path, sure.at_key and not sure.type_path
        )
    return Finding(
        message=f"{_claim(wrong, topic)}, but {fact}",
        path=place,
        key=wrong.at_key and not wrong.type_path,
        help=_help(sure, wrong),
        related=(related,),
        about=frozenset(
            {suppression_keys.topic(phase.phase, sure.topic), suppression_keys.value(place)}
        ),
        explains=frozenset({suppression_keys.flow(phase.phase), suppression_keys.value(place)}),
    )


def _claim(wrong: Endpoint, topic: str) -> str:
    if wrong.is_node:
        return f"{_who(wrong)} {_does(wrong)} {topic} as {wrong.type}"
    return f"the format of {topic} is given as {wrong.type}"


def _help(sure: Endpoint, wrong: Endpoint) -> str:
    if wrong.type_parameter:
        return f"set its parameter {quote(wrong.type_parameter)} to {sure.type}"
    return "" if wrong.is_node else f"write {sure.type}, or name another topic"


def _who(endpoint: Endpoint) -> str:
    if endpoint.monitor:
        return f"monitor {endpoint.monitor}"
    if endpoint.is_node:
        return endpoint.owner.rpartition("/")[2]
    return f"the {endpoint.owner}"


def _does(endpoint: Endpoint) -> str:
    return "publishes" if endpoint.writes else "reads"


RULE = Rule(
    code="R2B210",
    title="a topic of two types",
    severity=Severity.ERROR,
    why="ROS never connects a writer with a reader of another type, and says nothing about it.",
    failing=example(
        data_loader="""
            bag: r2b_storage
            topics: {/d455_1_rgb_camera_info: info}
        """,
        playback="{inputs: {image: {from: info, format: sensor_msgs/msg/Image}}}",
    ),
    passing=example(
        data_loader="""
            bag: r2b_storage
            topics: {/d455_1_rgb_image: image_raw}
        """,
        playback="{inputs: {image: {from: image_raw, format: sensor_msgs/msg/Image}}}",
    ),
    find=_find,
)
