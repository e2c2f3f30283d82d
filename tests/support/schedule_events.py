"""The events of schedules: as Python expands them one by one, and as the player gets them."""

from __future__ import annotations

import bisect
import itertools
from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

import numpy as np

from r2bspec.ipc.buffers import TF, BufferWriter
from r2bspec.ipc.playback_file import ENTRY_DTYPE, HEADER_BYTES, read_round, write_playback
from r2bspec.ipc.schedule import ALL_INPUTS, NO_STEP, CyclicSchedule, Schedule, TimelineSchedule

MESSAGE_BYTES = 12


class PlayedEvent(NamedTuple):
    """Messages to be published at one time.

    Attributes:
        offset_ns: the due time, relative to the first step of the playback.
        step: its number in the playback, or `NO_STEP`.
        messages: (input, position in the input's buffer, shift of its stamps) of each message;
            transforms have the number after the last input.
        inputs: the inputs of which the complete step has messages, as bits.
        stamp_ns: the stamp of the step, relative to the time of the first step; 0 for the time of
            its publication.
        complete: how many steps are complete once it is published.
    """

    offset_ns: int
    step: int
    messages: tuple[tuple[int, int, int], ...]
    inputs: int
    stamp_ns: int
    complete: int


def expected_events(
    schedule: Schedule, rate_hz: float, steps: int, first: int = 0
) -> list[PlayedEvent]:
    """The events one by one, as the documentation of schedules says it."""
    made = (
        _cyclic_events(schedule, rate_hz, steps, first)
        if isinstance(schedule, CyclicSchedule)
        else _timeline_events(schedule, steps)
    )
    found = list(made)
    left = [sum(each.step == step for each in found) for step in range(steps)]
    complete = 0
    for number, each in enumerate(found):
        if each.step != NO_STEP:
            left[each.step] -= 1
        while complete < steps and not left[complete]:
            complete += 1
        found[number] = each._replace(complete=complete)
    return found


def _cyclic_events(
    schedule: CyclicSchedule, rate_hz: float, steps: int, first: int
) -> Iterator[PlayedEvent]:
    period_ns = 1e9 / rate_hz
    length = len(schedule.steps)
    columns = schedule.columns or tuple(range(len(schedule.steps[0])))
    extras = schedule.between
    starts = [each.at for each in extras]
    inputs = sum(1 << column for column in columns) if schedule.columns else ALL_INPUTS
    for step in range(steps):
        place = (first + step) % length
        shifts = (
            schedule.stamp_offsets_ns[place] if schedule.stamp_offsets_ns else [0] * len(columns)
        )
        messages = tuple(zip(columns, schedule.steps[place], shifts, strict=True))
        begin, after, end = (
            bisect.bisect_left(starts, place),
            bisect.bisect_right(starts, place),
            bisect.bisect_left(starts, place + 1),
        )
        with_it = tuple((one.input, one.position, -one.origin_ns) for one in extras[begin:after])
        yield PlayedEvent(round(step * period_ns), step, messages + with_it, inputs, 0, 0)
        for extra in extras[after:end]:
            offset_ns = round((step + extra.at - place) * period_ns)
            played = ((extra.input, extra.position, -extra.origin_ns),)
            yield PlayedEvent(offset_ns, NO_STEP, played, ALL_INPUTS, 0, 0)


def _timeline_events(schedule: TimelineSchedule, steps: int) -> Iterator[PlayedEvent]:
    sizes = [sum(each.step == step for each in schedule.messages) for step in range(steps)]
    left: dict[int, int] = {}
    closed = 0
    for turn in itertools.count():
        base, begin_ns = turn * len(schedule.steps), turn * schedule.period_ns
        stamps_ns = turn * schedule.stamp_period_ns - schedule.origin_ns
        for each in schedule.messages:
            if closed == steps:
                return
            message = (each.input, each.position)
            offset_ns = begin_ns + each.offset_ns
            if each.step == NO_STEP:
                played = ((*message, 0),)
                yield PlayedEvent(offset_ns, NO_STEP, played, ALL_INPUTS, stamps_ns, 0)
                continue
            number = base + each.step
            if number >= steps:
                continue
            left[number] = left.get(number, sizes[each.step]) - 1
            closed += left[number] == 0
            step = schedule.steps[each.step]
            shifts = schedule.stamp_offsets_ns[each.step] if schedule.stamp_offsets_ns else ()
            shift_ns = shifts[each.input] if shifts else 0
            yield PlayedEvent(
                *(offset_ns, number, ((*message, shift_ns),)),
                *(step.inputs, step.stamp_ns + stamps_ns, 0),
            )


def played_events(
    schedule: Schedule, rate_hz: float, steps: int, first: int = 0
) -> list[PlayedEvent]:
    """The events in the files that a player gets, whose inputs are ``/0``, ``/1`` and so on."""
    with TemporaryDirectory() as scratch:
        folder = Path(scratch)
        sources = _write_buffers(folder, schedule)
        playback = folder / "playback"
        made = read_round(schedule, sources, [False] * len(sources), folder)
        write_playback(playback, made, rate_hz, steps, first)
        entries = np.fromfile(playback, dtype=ENTRY_DTYPE, offset=HEADER_BYTES)
        found, begin = [], 0
        while begin < entries.size:
            each = entries[begin]
            event = entries[begin : begin + int(each["left"])]
            assert event["left"].tolist() == list(range(event.size, 0, -1))
            for name in ("due_ns", "stamp_ns", "inputs", "step", "complete"):
                assert len(set(event[name])) == 1
            found.append(
                PlayedEvent(
                    int(each["due_ns"]),
                    int(each["step"]),
                    tuple(
                        (
                            int(one["source"]),
                            int(one["offset"]) // MESSAGE_BYTES,
                            int(one["add_ns"]),
                        )
                        for one in event
                    ),
                    int(each["inputs"]),
                    int(each["stamp_ns"]),
                    int(each["complete"]),
                )
            )
            begin += event.size
        return found


def _write_buffers(folder: Path, schedule: Schedule) -> list[str]:
    """Buffers with as many messages as are used; the message of /tf has no transforms."""
    if isinstance(schedule, TimelineSchedule):
        inputs = schedule.inputs
        positions = [message.position for message in schedule.messages]
    else:
        columns = schedule.columns or range(len(schedule.steps[0]))
        # The last one is that of /tf, or one whose messages look the same.
        inputs = max([*columns, *(between.input for between in schedule.between)])
        positions = [*itertools.chain(*schedule.steps)]
        positions += [between.position for between in schedule.between]
    topics = [f"/{number}" for number in range(inputs)]
    for topic in [*topics, TF]:
        writer = BufferWriter(folder, topic, "x/msg/Y", has_header=True)
        for stamp_ns in range(max(positions) + 1):
            writer.append(stamp_ns, bytes(MESSAGE_BYTES))
        writer.close()
    return topics
