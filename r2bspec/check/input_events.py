"""How many input events a reaction has in an iteration, as far as the recording tells."""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Sequence

from r2bspec.check.check_context import Context, window_holds
from r2bspec.language.spec import Monitor, PlaybackInput, Reaction
from r2bspec.plan.message_conditions import MessageCondition, message_condition
from r2bspec.plan.topic_plans import direct_bag_topic


def event_input(context: Context, reaction: Reaction) -> PlaybackInput | None:
    """The input of the events; None if there is none."""
    inputs = context.spec.playback.inputs
    wanted = context.wiring.topic(reaction.input) if reaction.input else ""
    named = (each for name, each in inputs.items() if context.wiring.topic(name) == wanted)
    return next(named, None) or next(iter(inputs.values()), None)


def most_events(context: Context, monitor: Monitor, steps: int) -> int | None:
    """The most events that count in an iteration of so many steps.

    None without a condition on the input, or if the recording does not tell.
    """
    spec, reaction = context.spec, monitor.reaction
    played = None if reaction is None else event_input(context, reaction)
    if reaction is None or reaction.source is None or played is None:
        return None
    topic = direct_bag_topic(context.wiring.topic(played.source), spec, context.wiring)
    condition = message_condition(reaction.source, played.format)
    if not topic or not isinstance(condition, MessageCondition):
        return None
    held = window_holds(context, topic, condition)
    if not held:
        return None
    held = held[: spec.playback.buffer or None]
    return most_within([*held, *(held[-2:0:-1] if spec.playback.mode == "sweeping" else [])], steps)


def most_within(held: Sequence[bool], steps: int) -> int:
    """The most events within so many steps, wherever they begin in a round.

    Args:
        held: for each step of a round, whether its message meets the condition.
        steps: of an iteration.
    """
    repeated = list(held) * (steps // len(held) + 2)
    before = [held[-1], *repeated]
    begins = [step for step, now in enumerate(repeated) if now and not before[step]]
    if before[0] and before[1]:
        begins.insert(0, -1)
    # An event counts if the step after its last one is in the iteration, or at its end.
    ends = [step for step in range(1, len(repeated)) if before[step] and not before[step + 1]]
    counts = (
        bisect_left(ends, first + steps + 1) - bisect_left(begins, first)
        for first in range(len(held))
    )
    return max(0, *counts)
