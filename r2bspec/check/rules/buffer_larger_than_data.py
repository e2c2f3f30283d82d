"""Buffers for more messages than there are."""

from __future__ import annotations

from collections.abc import Iterator

from r2bspec.check import suppression_keys
from r2bspec.check.check_context import Context
from r2bspec.check.example_spec import example
from r2bspec.check.finding import Finding
from r2bspec.check.message_text import counted
from r2bspec.check.rule import Rule
from r2bspec.check.window_counts import Amount, amounts
from r2bspec.diagnostics.diagnostic import Severity
from r2bspec.diagnostics.quote import quote
from r2bspec.wiring.build_wiring import harness_topic

_TOLERANCE = 1.5
"""How far an estimate must be exceeded before it is worth a word."""


def _find(context: Context) -> Iterator[Finding]:
    buffer = context.spec.playback.buffer
    if not buffer:
        return
    least: tuple[str, Amount] | None = None
    for name, amount in _amounts_by_input(context).items():
        enough = amount.messages if amount.exact else amount.messages * _TOLERANCE
        if buffer > enough and (least is None or amount.messages < least[1].messages):
            least = (name, amount)
    if least is not None:
        name, amount = least
        about = "" if amount.exact else "about "
        yield Finding(
            message=f"a buffer of {counted(buffer, 'message')} is larger than the "
            f"{about}{amount.messages:,} of {quote(name)} in the window",
            path=("playback", "buffer"),
            help="all of them are played, in turn; 0 says that",
            about=frozenset({suppression_keys.value(("data_loader", "window"))}),
        )


def _amounts_by_input(context: Context) -> dict[str, Amount]:
    """The most messages that each playback input can have.

    What preprocessors make of the loaded messages is taken to be at most one for each.
    """
    loaded = {
        harness_topic(context.spec.data_loader.topics[name], context.wiring.namespace): amount
        for name, amount in amounts(context).items()
    }
    reached = {topic: context.wiring.preprocess.reached_from([topic]) for topic in loaded}
    found = {}
    for name, each in context.spec.playback.inputs.items():
        source = harness_topic(each.source, context.wiring.namespace)
        feeding = [loaded[topic] for topic, below in reached.items() if source in below]
        if feeding:
            found[name] = max(feeding, key=lambda amount: amount.messages)
    return found


RULE = Rule(
    code="R2B322",
    title="a buffer larger than the data",
    severity=Severity.WARNING,
    why="Fewer different messages are played than the spec says.",
    failing=example(
        data_loader="""
            bag: r2b_storage
            window: {end: 0.5 s}
            topics: {/d455_1_rgb_image: image_raw}
        """,
        playback="""
            buffer: 30
            inputs:
              image: {from: image_raw, format: sensor_msgs/msg/Image}
        """,
    ),
    passing=example(
        data_loader="""
            bag: r2b_storage
            window: {end: 0.5 s}
            topics: {/d455_1_rgb_image: image_raw}
        """,
        playback="""
            buffer: 15
            inputs:
              image: {from: image_raw, format: sensor_msgs/msg/Image}
        """,
    ),
    find=_find,
)
