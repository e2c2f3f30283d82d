"""Buffers for more messages than the window has."""

from __future__ import annotations

from r2bspec.check.rule_api import (
    Context,
    Finding,
    Findings,
    Rule,
    pluralize,
    quote,
    value_key,
)
from r2bspec.check.window_counts import MessageCount, window_message_counts

_ESTIMATE_TOLERANCE = 1.5
"""Findings from an estimated count must exceed it by this factor."""


def _find(context: Context) -> Findings:
    buffer = context.spec.playback.buffer
    if not buffer:
        return
    smallest: tuple[str, MessageCount] | None = None
    for name, message_count in _counts_by_input(context).items():
        enough = (
            message_count.messages
            if message_count.exact
            else message_count.messages * _ESTIMATE_TOLERANCE
        )
        if buffer > enough and (smallest is None or message_count.messages < smallest[1].messages):
            smallest = (name, message_count)
    if smallest is not None:
        name, message_count = smallest
        about = "" if message_count.exact else "about "
        yield Finding(
            message=f"the buffer has {pluralize(buffer, 'message')}, but the window has "
            f"{about}{message_count.messages:,} of {quote(name)}",
            path=("playback", "buffer"),
            help="set 'buffer: 0' to play all messages of the window",
            suppressed_by={value_key(("data_loader", "window"))},
        )


def _counts_by_input(context: Context) -> dict[str, MessageCount]:
    """The maximum number of messages of each playback input.

    Preprocessors are assumed to publish at most one message for each loaded one.
    """
    loaded = {
        context.harness_topic(context.spec.data_loader.topics[name]): message_count
        for name, message_count in window_message_counts(context).items()
    }
    reached = {topic: context.wiring.preprocess.downstream_of([topic]) for topic in loaded}
    found = {}
    for name, each in context.spec.playback.inputs.items():
        source = context.harness_topic(each.source)
        feeding = [loaded[topic] for topic, below in reached.items() if source in below]
        if feeding:
            found[name] = max(feeding, key=lambda message_count: message_count.messages)
    return found


RULE = Rule(code="R2B322", find=_find)
