"""Playlists: the messages that a player publishes, where they are and which stamps they have.

A playlist is a table (`r2bspec.ipc.playback_file`) of entries of int64, which ``playlist.c``
checks::

    source, offset, size, place, add_ns, is_published

`source` is the number of an input of the plan, or that of /tf after them; `offset` is that of the
message in its buffer. At `place` in the message, unless it is -1, the player writes the stamp of
the event plus `add_ns`. A message with several stamps has an entry for each; only the last of them
is published.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from r2bspec.ipc import buffers
from r2bspec.ipc.disk_errors import named_errors
from r2bspec.ipc.header_stamps import STAMP_BYTES
from r2bspec.ipc.playback_events import (
    EVENT_DTYPE,
    CyclicRound,
    Events,
    Round,
    TimelineRound,
    complete_steps,
)
from r2bspec.ipc.playback_file import table_header
from r2bspec.ipc.schedule import ALL_INPUTS, NO_STEP, CyclicSchedule, Schedule, TimelineSchedule
from r2bspec.ipc.transform_stamps import TF, StampedTransforms

_MAGIC = b"R2BMSGS2"
_NO_PLACE = (-1, 0)
_STAMP_POSITION = STAMP_BYTES - 8

_Message = tuple[int, int, int]
"""Its source, its position in the buffer, and `shift_ns`."""

_Place = tuple[int, int]
"""Its position in the message, and the recorded stamp."""


@dataclass
class _Numbering:
    """The messages of a playlist; those of one event follow each other."""

    messages: list[_Message] = field(default_factory=list)
    _first: dict[tuple[_Message, ...], int] = field(default_factory=dict)

    def add(self, messages: Iterable[_Message]) -> tuple[int, int]:
        """The number of the first of them, and their count."""
        wanted = tuple(messages)
        first = self._first.setdefault(wanted, len(self.messages))
        if first == len(self.messages):
            self.messages += wanted
        return first, len(wanted)


def write_playlist(
    path: Path, schedule: Schedule, sources: Sequence[str], stamped: Sequence[bool], folder: Path
) -> Round:
    """Write the messages of a schedule for the native player.

    Args:
        path: of the new file.
        schedule: of the player.
        sources: the topics of the buffers, in the order of the inputs of the plan.
        stamped: for each of them, whether its messages get the stamp of the step in their headers.
        folder: has the buffers, also that of /tf if the schedule plays it.

    Returns:
        One round of the schedule, whose events refer to the messages.

    Raises:
        OSError: the disk is full, or a buffer is missing.
        ValueError: a message on /tf is damaged.
    """
    numbering = _Numbering()
    made = (
        _cyclic_round(numbering, schedule)
        if isinstance(schedule, CyclicSchedule)
        else _timeline_round(numbering, schedule)
    )
    shifts = isinstance(schedule, CyclicSchedule) or schedule.shift_transforms
    wanted: list[set[int]] = [set() for _ in range(len(sources) + 1)]
    for source, position, _ in numbering.messages:
        wanted[source].add(position)
    found = [
        _described(folder, topic, positions, stamped=has_stamp)
        for topic, has_stamp, positions in zip(sources, stamped, wanted[:-1], strict=True)
    ]
    found.append(_described(folder, TF, wanted[-1], shifts=shifts))
    entries: list[tuple[int, ...]] = []
    starts = [0]
    for source, position, shift_ns in numbering.messages:
        offset, size, places = found[source][position]
        for number, (place, stamp_ns) in enumerate(places, 1):
            add_ns, is_last = stamp_ns + shift_ns, number == len(places)
            entries.append((source, offset, size, place, add_ns, is_last))
        starts.append(len(entries))
    with named_errors(path), path.open("xb") as file:
        file.write(table_header(_MAGIC, len(entries)))
        file.write(np.array(entries, dtype="<i8").tobytes())
    return replace(made, events=_numbered_by_entry(made.events, np.array(starts)))


def _numbered_by_entry(events: Events, starts: NDArray[np.int64]) -> Events:
    """Events whose messages are entries of the file; `starts` has the first one of each message."""
    found = events.copy()
    found["first"] = starts[events["first"]]
    found["count"] = starts[events["first"] + events["count"]] - found["first"]
    return found


def _described(
    folder: Path,
    topic: str,
    positions: set[int],
    *,
    stamped: bool = False,
    shifts: bool = False,
) -> dict[int, tuple[int, int, list[_Place]]]:
    """The offset, the size and the places of stamps of each of these messages of a buffer."""
    if not positions:
        return {}
    transforms = buffers.read_messages(folder, topic, positions) if shifts else {}
    sizes = buffers.read_index(folder, topic).sizes
    offsets = np.cumsum([0, *sizes]).tolist()
    found = {}
    for position in positions:
        places: list[_Place] = []
        if position in transforms:
            places = StampedTransforms(transforms[position]).places()
        elif stamped and sizes[position] >= STAMP_BYTES:
            places = [(_STAMP_POSITION, 0)]
        found[position] = offsets[position], sizes[position], places or [_NO_PLACE]
    return found


def _cyclic_round(numbering: _Numbering, schedule: CyclicSchedule) -> CyclicRound:
    columns = schedule.columns or tuple(range(len(schedule.steps[0])))
    inputs = sum(1 << each for each in columns) if schedule.between else ALL_INPUTS
    extras = [each for each in schedule.without_step() if each[0] >= 0]
    rows, times = [], []
    taken = 0
    for step, positions in enumerate(schedule.steps):
        shifts = (
            schedule.stamp_offsets_ns[step] if schedule.stamp_offsets_ns else [0] * len(columns)
        )
        of_step = numbering.add(zip(columns, positions, shifts, strict=True))
        rows.append((0, 0, 0, 0, inputs, step, step + 1, *of_step))
        times.append(float(step))
        while taken < len(extras) and extras[taken][0] < step + 1:
            at, (source, position), origin_ns = extras[taken]
            between = numbering.add([(source, position, -origin_ns)])
            rows.append((0, 0, 0, 0, ALL_INPUTS, NO_STEP, step + 1, *between))
            times.append(at)
            taken += 1
    events: NDArray[np.void] = np.array(rows, dtype=EVENT_DTYPE)
    return CyclicRound(events, len(schedule.steps), np.array(times))


def _timeline_round(numbering: _Numbering, schedule: TimelineSchedule) -> TimelineRound:
    rows = []
    for each in schedule.messages:
        stamp_ns, inputs, shift_ns = 0, ALL_INPUTS, 0
        if each.step != NO_STEP:
            step = schedule.steps[each.step]
            stamp_ns, inputs = step.stamp_ns, step.inputs
            if schedule.stamp_offsets_ns:
                shift_ns = schedule.stamp_offsets_ns[each.step][each.input]
        message = numbering.add([(each.input, each.position, shift_ns)])
        stamp_ns -= schedule.origin_ns
        rows.append((each.offset_ns, stamp_ns, 0, 0, inputs, each.step, 0, *message))
    events: NDArray[np.void] = np.array(rows, dtype=EVENT_DTYPE)
    events["complete"] = complete_steps(events["step"])
    return TimelineRound(events, len(schedule.steps), schedule.period_ns, schedule.stamp_period_ns)
