"""Building a timeline from the buffers: the messages of each step, and their due times.

Messages with the same header stamp are one step, no matter how far apart they were recorded and on
how many inputs: a step of an IMU has no camera message. A message without a header is a step by
itself. Where the spec allows differences of stamps, messages of all inputs with a slop whose
stamps are near each other are one step, and the differences stay; a message without partners is a
step of its input alone. Messages from the bag are played at the times of their recording. Messages
of a preprocessor are played at the time at which the last message with their stamp was recorded or,
if the plan says so, at which they were published.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from r2bspec.execute.errors import RunError
from r2bspec.ipc.buffers import BufferIndex
from r2bspec.ipc.schedule import (
    NO_STEP,
    TimelineMessage,
    TimelineSchedule,
    TimelineStep,
    round_length_ns,
)
from r2bspec.plan.nearest_stamps import pair_nearest
from r2bspec.plan.plan import InputPlan, TimelinePlan

_MAX_TF_AGE_NS = 1_000_000_000
"""Transforms up to this age at the beginning of a timeline are published at its beginning."""


_StepKey = tuple[int, int, int]
"""A step: its stamp, its index among messages of one input with that stamp, and the input if it has
no header."""


class _TimedMessage(NamedTuple):
    """A message: its input, position, time and, if it has a header, its stamp.

    `paired_ns` is the latest stamp of its pair.
    """

    input: int
    position: int
    time_ns: int
    stamp_ns: int | None
    paired_ns: int | None = None

    @property
    def step_ns(self) -> int | None:
        """The stamp of its step."""
        return self.stamp_ns if self.paired_ns is None else self.paired_ns


def make_timeline(
    inputs: Sequence[tuple[InputPlan, BufferIndex]],
    sources: Sequence[BufferIndex],
    plan: TimelinePlan,
    buffer: int = 0,
    transforms: BufferIndex | None = None,
) -> tuple[TimelineSchedule, dict[str, int]]:
    """Schedule the messages of all inputs.

    Args:
        inputs: the inputs that are played, with their buffers.
        sources: the buffers of the bag.
        plan: how recorded time is converted to playback time.
        buffer: the maximum number of messages of each input; 0 keeps all.
        transforms: recorded /tf, if it is played.

    Returns:
        The timeline; and for each topic with such messages, how many are left out because no
        recorded message has their stamp.

    Raises:
        RunError: an input has no messages, or none with a known time.
    """
    by_stamp = times_by_stamp(sources)
    found: list[_TimedMessage] = []
    unknown: dict[str, int] = {}
    for column, (each, index) in enumerate(inputs):
        times_ns = [
            index.times_ns[position]
            if each.bag_topic or plan.recorded
            else by_stamp.get(index.stamps_ns[position])
            for position in range(len(index.sizes))[: buffer or None]
        ]
        known = [
            _TimedMessage(
                column,
                position,
                time_ns + each.later_ns,
                index.stamps_ns[position] + each.later_ns if index.has_header else None,
            )
            for position, time_ns in enumerate(times_ns)
            if time_ns is not None
        ]
        if not known:
            raise _no_messages_error(each, len(times_ns))
        if len(known) < len(times_ns):
            unknown[index.topic] = len(times_ns) - len(known)
        found += known
    slops_ns = [each.slop_ns for each, _ in inputs]
    paired = _pair(found, slops_ns) if any(slops_ns) else found
    return _build_timeline(paired, plan, len(inputs), transforms), unknown


def _pair(found: list[_TimedMessage], slops_ns: Sequence[int]) -> list[_TimedMessage]:
    """The messages, with the stamp of their pair where they have one."""
    by_input: dict[int, list[tuple[int, int]]] = {}
    for place, each in enumerate(found):
        if each.stamp_ns is not None and slops_ns[each.input]:
            by_input.setdefault(each.input, []).append((place, each.stamp_ns))
    columns = list(by_input)
    stamps = [[stamp_ns for _, stamp_ns in by_input[column]] for column in columns]
    pairs = pair_nearest(stamps, [slops_ns[column] for column in columns])
    paired = list(found)
    for pair in pairs:
        members = [by_input[column][number] for column, number in zip(columns, pair, strict=True)]
        latest_ns = max(stamp_ns for _, stamp_ns in members)
        for place, _ in members:
            paired[place] = found[place]._replace(paired_ns=latest_ns)
    return paired


def times_by_stamp(sources: Sequence[BufferIndex]) -> dict[int, int]:
    """For each stamp, the time at which the last message with it was recorded."""
    found: dict[int, int] = {}
    for index in sources:
        if index.has_header:
            for stamp_ns, time_ns in zip(index.stamps_ns, index.times_ns, strict=True):
                found[stamp_ns] = max(time_ns, found.get(stamp_ns, time_ns))
    return found


def _no_messages_error(plan: InputPlan, count: int) -> RunError:
    if not count:
        return RunError(
            f"no messages were buffered for {plan.source}",
            hint="Check the window, and the messages that the preprocessors publish.",
            code="R2B643",
        )
    return RunError(
        f"none of the {count} messages on {plan.source} has the stamp of a recorded message, so "
        "their times are unknown",
        hint="Keep the stamps in the preprocessors, or set 'record_timeline: true' to play the "
        "messages at the times at which they are published.",
        code="R2B659",
    )


def _build_timeline(
    found: list[_TimedMessage], plan: TimelinePlan, inputs: int, transforms: BufferIndex | None
) -> TimelineSchedule:
    found.sort(key=lambda each: (each.time_ns, each.input, each.position))
    start_ns = found[0].time_ns
    keys, first_ns, masks = _steps(found)
    stamps = _unique_stamps({key: key[0] for key in masks})
    numbers = {key: number for number, key in enumerate(first_ns)}
    length_ns = max(round_length_ns(list(first_ns.values())), found[-1].time_ns - start_ns + 1)
    messages = [
        TimelineMessage(
            round((each.time_ns - start_ns) / plan.speed), numbers[key], each.input, each.position
        )
        for each, key in zip(found, keys, strict=True)
    ]
    if transforms is not None:
        messages += _transform_messages(transforms, start_ns, length_ns, plan.speed, inputs)
        # The transforms of a message are published before it.
        messages.sort(key=lambda each: (each.offset_ns, each.step != NO_STEP))
    spread_ns = max(stamps.values()) - min(stamps.values())
    return TimelineSchedule(
        steps=tuple(TimelineStep(stamps[key], masks[key]) for key in first_ns),
        messages=tuple(messages),
        # No message has a stamp later than its publication; the latest stamp equals it.
        origin_ns=start_ns
        + max((e.stamp_ns - e.time_ns for e in found if e.stamp_ns is not None), default=0),
        period_ns=max(round(length_ns / plan.speed), messages[-1].offset_ns + 1),
        stamp_period_ns=max(length_ns, spread_ns + 1),
        inputs=inputs,
        shift_transforms=plan.shift_tf,
        stamp_offsets_ns=_stamp_offsets(found, keys, numbers, inputs),
    )


def _stamp_offsets(
    found: list[_TimedMessage], keys: list[_StepKey], numbers: dict[_StepKey, int], inputs: int
) -> tuple[tuple[int, ...], ...]:
    """For each step and input, the stamp of the message minus that of the step; empty if all 0."""
    offsets = [[0] * inputs for _ in numbers]
    for each, key in zip(found, keys, strict=True):
        if each.stamp_ns is not None and each.step_ns is not None:
            offsets[numbers[key]][each.input] = each.stamp_ns - each.step_ns
    return tuple(map(tuple, offsets)) if any(map(any, offsets)) else ()


def _steps(
    found: list[_TimedMessage],
) -> tuple[list[_StepKey], dict[_StepKey, int], dict[_StepKey, int]]:
    """The step of each message; and, in order of time, the start and the inputs of each step."""
    counts: dict[tuple[int, int | None], int] = {}
    keys = []
    first_ns: dict[_StepKey, int] = {}
    masks: dict[_StepKey, int] = {}
    for each in found:
        # A device may repeat a stamp; the n-th messages with it belong to one step.
        nth = counts.get((each.input, each.step_ns), 0)
        counts[each.input, each.step_ns] = nth + 1
        key = _key(each, nth)
        keys.append(key)
        first_ns.setdefault(key, each.time_ns)
        masks[key] = masks.get(key, 0) | 1 << each.input
    return keys, first_ns, masks


def _key(message: _TimedMessage, nth: int) -> _StepKey:
    if message.step_ns is None:
        return message.time_ns, nth, message.input
    return message.step_ns, nth, -1


def _unique_stamps(stamps: dict[_StepKey, int]) -> dict[_StepKey, int]:
    """The stamps, with repeated ones increased by nanoseconds: outputs are identified by them."""
    last_ns: int | None = None
    found = {}
    for key in sorted(stamps):
        stamp_ns = stamps[key] if last_ns is None else max(stamps[key], last_ns + 1)
        found[key] = last_ns = stamp_ns
    return found


def _transform_messages(
    transforms: BufferIndex, start_ns: int, length_ns: int, speed: float, column: int
) -> list[TimelineMessage]:
    """The transforms of a round; those from shortly before its beginning are due with it."""
    return [
        TimelineMessage(round(max(0, time_ns - start_ns) / speed), NO_STEP, column, position)
        for position, time_ns in enumerate(transforms.times_ns)
        if -_MAX_TF_AGE_NS <= time_ns - start_ns < length_ns
    ]
