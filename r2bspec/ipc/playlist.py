"""Playlists: a schedule and where its messages are, for the native player.

A playlist is one file of little-endian int64, which `r2bspec/native/schedule.c` maps and checks::

    magic "R2BPLAY1", cyclic, files, path_bytes, messages, places, refs, events, steps,
    period_ns, stamp_period_ns, origin_ns, earliest_stamp_ns
    paths       NUL-terminated, together `path_bytes` long, which is a multiple of 8
    messages    source, file, offset, size, first_place, places
    places      position in the message, recorded stamp in ns: of the stamps of transforms
    refs        message, stamp minus that of the step in ns
    events      step in the round or -1, at, inputs, stamp_ns, origin_ns, first_ref, refs

The events are one round. `at` is the due time in ns; in a cyclic schedule, it is a float64 in steps
from the beginning of the round, and 0 for steps. The meaning of everything else is that of
`r2bspec.ipc.schedule`.
"""

from __future__ import annotations

import struct
from array import array
from collections.abc import Sequence
from pathlib import Path

from r2bspec.ipc import buffers
from r2bspec.ipc.disk_errors import named_errors
from r2bspec.ipc.schedule import (
    ALL_INPUTS,
    NO_STEP,
    CyclicSchedule,
    Schedule,
    TimelineSchedule,
)
from r2bspec.ipc.transform_stamps import TF, StampedTransforms

_MAGIC = b"R2BPLAY1"
_HEADER = struct.Struct("<8s12q")


class _Playlist:
    """The arrays of a playlist while it is written."""

    def __init__(self) -> None:
        self.files: list[str] = []
        self.messages = array("q")
        self.places = array("q")
        self.refs = array("q")
        self.events = array("q")
        self._numbers: dict[tuple[int, int], int] = {}

    def add_source(
        self, source: int, folder: Path, topic: str, positions: set[int], *, shifted: bool
    ) -> None:
        """Add the messages of a buffer; the stamps in them are `shifted` if they are transforms."""
        if not positions:
            return
        self.files.append(str(buffers.buffer_path(folder, topic, "cdr")))
        transforms = buffers.read_messages(folder, topic, positions) if shifted else {}
        offset = 0
        for position, size in enumerate(buffers.read_index(folder, topic).sizes):
            if position in positions:
                first = len(self.places) // 2
                if shifted:
                    for place, stamp_ns in StampedTransforms(transforms[position]).places():
                        self.places.extend((place, stamp_ns))
                self._numbers[source, position] = len(self.messages) // 6
                places = len(self.places) // 2 - first
                self.messages.extend((source, len(self.files) - 1, offset, size, first, places))
            offset += size

    def add_event(
        self,
        step: int,
        at: int,
        messages: Sequence[tuple[int, int]],
        *,
        inputs: int = ALL_INPUTS,
        stamp_ns: int = 0,
        origin_ns: int = 0,
        stamp_offsets_ns: Sequence[int] = (),
    ) -> None:
        first = len(self.refs) // 2
        for number, message in enumerate(messages):
            offset_ns = stamp_offsets_ns[number] if stamp_offsets_ns else 0
            self.refs.extend((self._numbers[message], offset_ns))
        self.events.extend((step, at, inputs, stamp_ns, origin_ns, first, len(messages)))


def write_playlist(path: Path, schedule: Schedule, sources: Sequence[str], folder: Path) -> None:
    """Write a schedule for the native player.

    Args:
        path: of the new file.
        schedule: of the player.
        sources: the topics of the buffers, in the order of the inputs of the plan.
        folder: has the buffers, also that of /tf if the schedule plays it.

    Raises:
        OSError: the disk is full, or a buffer is missing.
        ValueError: a message on /tf is damaged.
    """
    made = _Playlist()
    shifts = schedule.shift_transforms if isinstance(schedule, TimelineSchedule) else True
    topics = [*sources, TF]
    used = schedule.positions_used()
    for source, (topic, positions) in enumerate(zip(topics, used, strict=True)):
        is_transform = source == len(sources)
        made.add_source(source, folder, topic, positions, shifted=is_transform and shifts)
    numbers = (
        _add_cyclic(made, schedule)
        if isinstance(schedule, CyclicSchedule)
        else _add_timeline(made, schedule)
    )
    paths = b"".join(each.encode(errors="surrogateescape") + b"\0" for each in made.files)
    paths += b"\0" * (-len(paths) % 8)
    counts = (len(made.messages) // 6, len(made.places) // 2, len(made.refs) // 2)
    header = _HEADER.pack(
        _MAGIC,
        int(isinstance(schedule, CyclicSchedule)),
        *(len(made.files), len(paths), *counts, len(made.events) // 7, len(schedule.steps)),
        *numbers,
    )
    with named_errors(path), path.open("wb") as file:
        file.write(header + paths)
        for each in (made.messages, made.places, made.refs, made.events):
            file.write(each.tobytes())


def _add_cyclic(made: _Playlist, schedule: CyclicSchedule) -> tuple[int, int, int, int]:
    """Add the events of one round; they are those of one playback at one step per second."""
    extras = [each for each in schedule.without_step() if each[0] >= 0]
    taken = 0
    for event in schedule.events(1.0, len(schedule.steps)):
        if event.step == NO_STEP:
            continue
        made.add_event(
            event.step,
            0,
            event.messages,
            inputs=event.inputs,
            stamp_offsets_ns=event.stamp_offsets_ns,
        )
        while taken < len(extras) and extras[taken][0] < event.step + 1:
            at, message, origin_ns = extras[taken]
            made.add_event(NO_STEP, _bits(at), (message,), origin_ns=origin_ns)
            taken += 1
    return (0, 0, 0, 0)


def _bits(value: float) -> int:
    """A float64 as the int64 with the same bits."""
    return int(struct.unpack("<q", struct.pack("<d", value))[0])


def _add_timeline(made: _Playlist, schedule: TimelineSchedule) -> tuple[int, int, int, int]:
    for each in schedule.messages:
        message = ((each.input, each.position),)
        if each.step == NO_STEP:
            made.add_event(NO_STEP, each.offset_ns, message)
            continue
        step = schedule.steps[each.step]
        offsets_ns = schedule.stamp_offsets_ns[each.step] if schedule.stamp_offsets_ns else ()
        made.add_event(
            each.step,
            each.offset_ns,
            message,
            inputs=step.inputs,
            stamp_ns=step.stamp_ns,
            stamp_offsets_ns=offsets_ns[each.input : each.input + 1],
        )
    return (
        *(schedule.period_ns, schedule.stamp_period_ns, schedule.origin_ns),
        schedule.earliest_stamp_ns(),
    )
