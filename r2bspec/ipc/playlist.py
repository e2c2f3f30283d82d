"""Playlists: a schedule and where its messages are, as one round of what the player gets."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from r2bspec.ipc import buffers
from r2bspec.ipc.header_stamps import STAMP_BYTES
from r2bspec.ipc.playback_events import (
    ENTRY_DTYPE,
    CyclicRound,
    Round,
    TimelineRound,
    complete_steps,
)
from r2bspec.ipc.schedule import ALL_INPUTS, NO_STEP, CyclicSchedule, Schedule, TimelineSchedule
from r2bspec.ipc.transform_stamps import TF, StampedTransforms

_STAMP_POSITION = STAMP_BYTES - 8
_NO_PLACE = (-1, 0)


class _Buffers:
    """Where the messages of all sources are; a source is read when the first of them is played."""

    def __init__(
        self, sources: Sequence[str], stamped: Sequence[bool], folder: Path, *, shifts: bool
    ) -> None:
        self._topics = [*sources, TF]
        self._stamped = [*stamped, False]
        self._folder = folder
        self._transforms = b""
        if shifts and buffers.buffer_path(folder, TF, "cdr").exists():
            self._transforms = buffers.buffer_path(folder, TF, "cdr").read_bytes()
        self._found: dict[int, tuple[tuple[int, ...], list[int]]] = {}

    def find(self, source: int, position: int) -> tuple[int, int, list[tuple[int, int]]]:
        """The offset and the size of a message, and its stamps: the place and what is in it now."""
        if source not in self._found:
            sizes = buffers.read_index(self._folder, self._topics[source]).sizes
            self._found[source] = sizes, np.cumsum([0, *sizes]).tolist()
        offset, size = self._found[source][1][position], self._found[source][0][position]
        places = []
        if source == len(self._topics) - 1 and self._transforms:
            message = bytearray(self._transforms[offset : offset + size])
            places = StampedTransforms(message).places()
        elif self._stamped[source] and size >= STAMP_BYTES:
            # The stamp of a header is replaced, whatever it is.
            places = [(_STAMP_POSITION, 0)]
        return offset, size, places or [_NO_PLACE]


class _Entries:
    """The entries of a round while it is made."""

    def __init__(self, found: _Buffers) -> None:
        self._buffers = found
        self.rows: list[tuple[int, ...]] = []
        self.at: list[float] = []

    def add(
        self,
        messages: Sequence[tuple[int, int, int]],
        *,
        step: int,
        inputs: int = ALL_INPUTS,
        at: float = 0.0,
        due_ns: int = 0,
        stamp_ns: int = 0,
        complete: int = 0,
    ) -> None:
        """Add an event; a message is its source, its position there, and a shift of its stamps."""
        stamps = [
            (offset, stamp_in_it_ns + shift_ns, size, place, source, number == len(places))
            for source, position, shift_ns in messages
            for offset, size, places in [self._buffers.find(source, position)]
            for number, (place, stamp_in_it_ns) in enumerate(places, 1)
        ]
        for number, each in enumerate(stamps):
            left = len(stamps) - number
            self.rows.append((due_ns, stamp_ns, 0, 0, inputs, *each, left, step, complete))
            self.at.append(at)

    def array(self) -> NDArray[np.void]:
        """The entries; of type `ENTRY_DTYPE`."""
        return np.array(self.rows, dtype=ENTRY_DTYPE)


def read_round(
    schedule: Schedule, sources: Sequence[str], stamped: Sequence[bool], folder: Path
) -> Round:
    """One round of what the player gets for a schedule.

    Args:
        schedule: of the player.
        sources: the topics of the buffers, in the order of the inputs of the plan.
        stamped: for each of them, whether its messages get the stamp of the step in their headers.
        folder: has the buffers, also that of /tf if the schedule plays it.

    Raises:
        OSError: a buffer is missing.
        ValueError: a message on /tf is damaged.
    """
    if isinstance(schedule, CyclicSchedule):
        return _cyclic_round(_Entries(_Buffers(sources, stamped, folder, shifts=True)), schedule)
    shifts = schedule.shift_transforms
    return _timeline_round(_Entries(_Buffers(sources, stamped, folder, shifts=shifts)), schedule)


def _cyclic_round(entries: _Entries, schedule: CyclicSchedule) -> CyclicRound:
    columns = schedule.columns or tuple(range(len(schedule.steps[0])))
    inputs = sum(1 << each for each in columns) if schedule.between else ALL_INPUTS
    extras = [each for each in schedule.without_step() if each[0] >= 0]
    taken = 0
    for step, positions in enumerate(schedule.steps):
        shifts = schedule.stamp_offsets_ns[step : step + 1] or [(0,) * len(columns)]
        of_step = list(zip(columns, positions, shifts[0], strict=True))
        entries.add(of_step, step=step, inputs=inputs, at=float(step), complete=step + 1)
        while taken < len(extras) and extras[taken][0] < step + 1:
            at, (source, position), origin_ns = extras[taken]
            between = [(source, position, -origin_ns)]
            entries.add(between, step=NO_STEP, at=at, complete=step + 1)
            taken += 1
    return CyclicRound(entries.array(), len(schedule.steps), np.array(entries.at))


def _timeline_round(entries: _Entries, schedule: TimelineSchedule) -> TimelineRound:
    for each in schedule.messages:
        stamp_ns, inputs, shift_ns = 0, ALL_INPUTS, 0
        if each.step != NO_STEP:
            step = schedule.steps[each.step]
            stamp_ns, inputs = step.stamp_ns, step.inputs
            if schedule.stamp_offsets_ns:
                shift_ns = schedule.stamp_offsets_ns[each.step][each.input]
        entries.add(
            [(each.input, each.position, shift_ns)],
            step=each.step,
            inputs=inputs,
            due_ns=each.offset_ns,
            stamp_ns=stamp_ns - schedule.origin_ns,
        )
    found = entries.array()
    found["complete"] = complete_steps(found["step"])
    return TimelineRound(found, len(schedule.steps), schedule.period_ns, schedule.stamp_period_ns)
