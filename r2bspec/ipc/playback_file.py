"""Playback files: when a player publishes what, and when it did so.

The controller writes a file for each playback, and the player (``player.c``) maps it, plays it, and
writes the times into it. A file has the entries (`ENTRY_DTYPE`) after a header, all little-endian::

    int64 published, magic "R2BPLAY5", int64 entries, is_loaded, has_stamps, least_ns, begin_ns,
    clocks

With `is_loaded` 0 nothing is played: the player loads these messages into memory.
`has_stamps` is 1 if the stamps of a recording are shifted to the beginning of the playback, which
is then given a system time of at least `least_ns`; otherwise this is the least stamp. Stamps of
earlier playbacks are not repeated in this way, although stamps may be ahead of the clock.
`begin_ns` is when the first entry is due; with 0 that is soon. Behind the entries, `clocks` int64
for each of them: the processor time of each watched process when the entry was due.
The first `published` entries are complete: the player writes them before it counts them, so that
this process can read while it plays, and after it was killed.

An event is the messages that are published at one time; it has an entry for each of them.
`read_round` makes one round of entries from a schedule and the buffers that have its messages.
"""

from __future__ import annotations

import struct
from collections import deque
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from r2bspec.bags.message_types import STAMP_BYTES
from r2bspec.ipc import buffers
from r2bspec.ipc.buffers import TF, transform_stamps
from r2bspec.ipc.sample_files import named_errors
from r2bspec.ipc.schedule import (
    ALL_INPUTS,
    NO_STEP,
    BetweenMessage,
    CyclicSchedule,
    Schedule,
    TimelineSchedule,
)

ENTRY_DTYPE = np.dtype(
    [
        ("due_ns", "<i8"),
        ("stamp_ns", "<i8"),
        ("published_ns", "<i8"),
        ("done_ns", "<i8"),
        ("inputs", "<i8"),
        ("offset", "<i8"),
        ("add_ns", "<i8"),
        ("size", "<i4"),
        ("place", "<i4"),
        ("source", "<i2"),
        ("is_published", "<i2"),
        ("left", "<i4"),
        ("step", "<i4"),
        ("complete", "<i4"),
    ]
)
"""One entry of a playback.

- `due_ns`: when its event is due, relative to the first step.
- `stamp_ns`: the stamp of the event, relative to the beginning of a playback that has stamps; 0 for
  the time of publication.
- `published_ns`, `done_ns`: when publishing began and ended; the player writes them, as the times
  above, into the first entry of the event, and the last one into the last entry.
- `inputs`: the inputs of the plan of which the complete step has messages, as bits; -1 for all.
- `source`, `offset`, `size`: where the message is; a source is an input of the plan, or /tf after
  them.
- `place`, `add_ns`: where in the message the player writes the stamp of the event plus `add_ns`;
  -1 for nowhere.
- `is_published`: a message with several stamps has an entry for each of them, of which the last is
  published.
- `left`: the entries of the event from this one on.
- `step`: of the playback, or `NO_STEP`.
- `complete`: how many steps, from the first, are complete once the event is published.
"""

Entries = NDArray[np.void]

_BLOCK = 1 << 17
"""Entries that are computed at once: 10 MB."""


@dataclass(frozen=True)
class Round:
    """A round of a schedule.

    Attributes:
        entries: of type `ENTRY_DTYPE`, in the order in which they are due. Steps and `complete`
            count from the beginning of the round.
        steps: how many it has.
    """

    entries: Entries
    steps: int

    def blocks(self, rate_hz: float, steps: int, first: int) -> Iterator[Entries]:
        """Yield the entries of a playback, in blocks.

        Args:
            rate_hz: steps per second.
            steps: how many.
            first: the step of the round to begin with.
        """
        begin, end = self._bounds(steps, first)
        for start in range(begin, end, _BLOCK):
            turns, places = np.divmod(np.arange(start, min(start + _BLOCK, end)), self.entries.size)
            entries_of = self.entries[places]
            numbers = turns * self.steps - first
            entries_of["complete"] += numbers.astype(np.int32)
            entries_of["step"] += np.where(entries_of["step"] == NO_STEP, 0, numbers).astype(
                np.int32
            )
            self._set_times(entries_of, turns, places, rate_hz)
            # Steps of a recording may overlap: the last ones go on into those after them.
            rows = entries_of[entries_of["step"] < steps]
            rows["complete"] = np.minimum(rows["complete"], steps)
            yield rows

    def _bounds(self, steps: int, first: int) -> tuple[int, int]:
        """Return the first entry of a playback and the entry after its last."""
        raise NotImplementedError

    def _set_times(
        self, entries: Entries, turns: NDArray[np.int64], places: NDArray[np.int64], rate_hz: float
    ) -> None:
        """Set due times and stamps; each entry is at one of `places` of one of the rounds."""
        raise NotImplementedError


@dataclass(frozen=True)
class CyclicRound(Round):
    """A round of steps without times.

    Attributes:
        at: for each entry, when it is due, in steps from the beginning of the round.
    """

    at: NDArray[np.float64]

    def _bounds(self, steps: int, first: int) -> tuple[int, int]:
        _, starts = np.unique(self.entries["step"], return_index=True)
        starts = starts[-self.steps :]  # without what belongs to no step
        turns, rest = divmod(first + steps, self.steps)
        return int(starts[first]), turns * self.entries.size + int(starts[rest])

    def _set_times(
        self, entries: Entries, turns: NDArray[np.int64], places: NDArray[np.int64], rate_hz: float
    ) -> None:
        del turns
        # What is between two steps comes after the one that it completes nothing more than.
        steps = entries["complete"] - 1
        in_round = self.entries["complete"][places] - 1
        # Relative to the first due time, so that rounding errors do not accumulate.
        entries["due_ns"] = np.rint((steps + self.at[places] - in_round) * (1e9 / rate_hz))


@dataclass(frozen=True)
class TimelineRound(Round):
    """A round of a recording; every playback starts at its beginning, so that all are equal.

    The due times and stamps of `entries` are those of the first round.

    Attributes:
        period_ns: the duration of a round.
        stamp_period_ns: the same in the recording.
    """

    period_ns: int
    stamp_period_ns: int

    def _bounds(self, steps: int, first: int) -> tuple[int, int]:
        del first
        if steps == 0:
            return 0, 0
        turns, last = divmod(steps - 1, self.steps)
        # Steps may overlap: the playback ends when all of them are complete.
        of_last_round = (self.entries["step"] >= 0) & (self.entries["step"] <= last)
        return 0, turns * self.entries.size + int(np.flatnonzero(of_last_round)[-1]) + 1

    def _set_times(
        self, entries: Entries, turns: NDArray[np.int64], places: NDArray[np.int64], rate_hz: float
    ) -> None:
        del places, rate_hz
        entries["due_ns"] += turns * self.period_ns
        entries["stamp_ns"] += turns * self.stamp_period_ns


def complete_steps(steps: NDArray[np.int32]) -> NDArray[np.int32]:
    """Return, for each entry of a round, how many steps are complete once it is published.

    Args:
        steps: of each entry, or `NO_STEP`. Every step has an entry.
    """
    of_steps = np.flatnonzero(steps != NO_STEP)
    last = np.zeros(int(steps.max()) + 1, dtype=np.int64)
    np.maximum.at(last, steps[of_steps], of_steps)
    completed_by = np.maximum.accumulate(last)
    return np.searchsorted(completed_by, np.arange(steps.size), side="right").astype(np.int32)


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
        """Return the offset and size of a message, and the position and value of its stamps."""
        if source not in self._found:
            sizes = buffers.read_index(self._folder, self._topics[source]).sizes
            self._found[source] = sizes, np.cumsum([0, *sizes]).tolist()
        offset, size = self._found[source][1][position], self._found[source][0][position]
        places = []
        if source == len(self._topics) - 1 and self._transforms:
            places = transform_stamps(self._transforms[offset : offset + size])
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
        for number, stamp in enumerate(stamps):
            left = len(stamps) - number
            self.rows.append((due_ns, stamp_ns, 0, 0, inputs, *stamp, left, step, complete))
            self.at.append(at)

    def array(self) -> NDArray[np.void]:
        """Return the entries; of type `ENTRY_DTYPE`."""
        return np.array(self.rows, dtype=ENTRY_DTYPE)


def read_round(
    schedule: Schedule, sources: Sequence[str], stamped: Sequence[bool], folder: Path
) -> Round:
    """Return a round of the data that the player gets for a schedule.

    Args:
        schedule: the schedule of the player.
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
    inputs = sum(1 << column for column in columns) if schedule.columns else ALL_INPUTS
    extras = deque(schedule.between)
    for step, positions in enumerate(schedule.steps):
        shifts = schedule.stamp_offsets_ns[step : step + 1] or [(0,) * len(columns)]
        event = list(zip(columns, positions, shifts[0], strict=True))
        # What was stamped as the step keeps that: nodes may combine messages of equal stamps.
        while extras and extras[0].at == step:
            event.append(_message(extras.popleft()))
        entries.add(event, step=step, inputs=inputs, at=float(step), complete=step + 1)
        while extras and extras[0].at < step + 1:
            at = extras[0].at
            between = [_message(extras.popleft())]
            entries.add(between, step=NO_STEP, at=at, complete=step + 1)
    return CyclicRound(entries.array(), len(schedule.steps), np.array(entries.at))


def _message(extra: BetweenMessage) -> tuple[int, int, int]:
    return extra.input, extra.position, -extra.origin_ns


def _timeline_round(entries: _Entries, schedule: TimelineSchedule) -> TimelineRound:
    for message in schedule.messages:
        stamp_ns, inputs, shift_ns = 0, ALL_INPUTS, 0
        if message.step != NO_STEP:
            step = schedule.steps[message.step]
            stamp_ns, inputs = step.stamp_ns, step.inputs
            if schedule.stamp_offsets_ns:
                shift_ns = schedule.stamp_offsets_ns[message.step][message.input]
        entries.add(
            [(message.input, message.position, shift_ns)],
            step=message.step,
            inputs=inputs,
            due_ns=message.offset_ns,
            stamp_ns=stamp_ns - schedule.origin_ns,
        )
    array = entries.array()
    array["complete"] = complete_steps(array["step"])
    return TimelineRound(array, len(schedule.steps), schedule.period_ns, schedule.stamp_period_ns)


_MAGIC = b"R2BPLAY5"
_HEADER = struct.Struct("<q8s6q")
HEADER_BYTES = _HEADER.size
_CLOCK_DTYPE = np.dtype("<i8")


def playback_path(path: Path, number: int) -> Path:
    """Return the file of a playback; `number` counts from 1."""
    return path.with_name(f"{path.name}-{number}")


def write_playlist(path: Path, made: Round) -> None:
    """Write the file of all messages, which the player loads before it plays any of them.

    Raises:
        OSError: the disk is full; it has the name of the file.
    """
    _write(path, made.blocks(1.0, made.steps, 0), is_loaded=False)


def write_playback(
    path: Path,
    made: Round,
    rate_hz: float,
    steps: int,
    first: int = 0,
    last_stamp_ns: int = 0,
    *,
    clocks: int = 0,
    begin_ns: int = 0,
    delays_ns: Sequence[int] = (),
) -> None:
    """Write the file of a playback.

    Args:
        path: the path of the new file.
        made: one round of the schedule.
        rate_hz: steps per second; without effect on a recording, which has its own times.
        steps: how many.
        first: the step of the round to begin with; also without effect on a recording.
        last_stamp_ns: the last stamp of earlier playbacks.
        clocks: how many processes the player watches.
        begin_ns: when the first step is due; 0 for soon.
        delays_ns: how much later than at `rate_hz` each step is due, and what is played between it
            and the next step; empty for no delay.

    Raises:
        OSError: the disk is full; it has the name of the file.
    """
    has_stamps = isinstance(made, TimelineRound)
    least_ns = last_stamp_ns + 1
    if has_stamps:
        least_ns -= int(made.entries["stamp_ns"][made.entries["step"] != NO_STEP].min())
        first = 0
    blocks = made.blocks(rate_hz, steps, first)
    if delays_ns:
        blocks = _delayed(blocks, np.array(delays_ns, dtype=np.int64))
    _write(
        path,
        blocks,
        is_loaded=True,
        has_stamps=has_stamps,
        least_ns=least_ns,
        begin_ns=begin_ns,
        clocks=clocks,
    )


def _delayed(blocks: Iterable[Entries], delays_ns: NDArray[np.int64]) -> Iterator[Entries]:
    """Delay all entries up to the next step by the delay of their step, but not beyond that one."""
    for block in blocks:
        block["due_ns"] += delays_ns[np.maximum(block["complete"] - 1, 0)]
        block["due_ns"] = np.minimum.accumulate(block["due_ns"][::-1])[::-1]
        yield block


def _write(
    path: Path,
    blocks: Iterable[Entries],
    *,
    is_loaded: bool,
    has_stamps: bool = False,
    least_ns: int = 0,
    begin_ns: int = 0,
    clocks: int = 0,
) -> None:
    # Under its name it is complete, whatever happens.
    part = path.with_name(f".{path.name}.part")
    with named_errors(path), part.open("xb") as file:
        file.write(bytes(HEADER_BYTES))
        count = 0
        for block in blocks:
            file.write(block.data)
            count += block.size
        file.truncate(file.tell() + count * clocks * _CLOCK_DTYPE.itemsize)
        file.seek(0)
        file.write(
            _HEADER.pack(0, _MAGIC, count, is_loaded, has_stamps, least_ns, begin_ns, clocks)
        )
    part.rename(path)


class PlaybackReader:
    """Reads the steps that a player has played so far, as one sequence over all its playbacks.

    A step is included once it and all steps before it are complete. Its row has the stamp and the
    times of its first entry, and the end of its last entry.

    Args:
        path: the files are ``PATH-1``, ``PATH-2`` and so on.
        fields: of a row, as `r2bspec.record.sample_arrays.PLAYBACK_FIELDS`.
    """

    def __init__(self, path: Path, fields: tuple[tuple[str, str], ...]) -> None:
        self._path = path
        self._dtype = np.dtype(list(fields))
        self._playbacks: list[_Playback] = []

    def count(self) -> int:
        """Return the number of complete steps; 0 before the first playback."""
        self._find_playbacks()
        return sum(playback.complete() for playback in self._playbacks)

    def read(self, start: int = 0, stop: int | None = None) -> NDArray[np.void]:
        """Return the rows from `start` up to `stop`, or up to the last complete step."""
        self._find_playbacks()
        blocks = [np.empty(0, self._dtype)]
        begin = 0
        for playback in self._playbacks:
            count = playback.complete()
            last = count if stop is None else min(count, stop - begin)
            if last > max(0, start - begin):
                blocks.append(playback.rows(max(0, start - begin), last, self._dtype))
            begin += count
        return np.concatenate(blocks)

    def last_stamp_ns(self) -> int:
        """Return the last stamp of a step that was played; 0 before the first step."""
        self._find_playbacks()
        # Stamps ascend from playback to playback.
        stamps_ns = (playback.last_stamp_ns() for playback in reversed(self._playbacks))
        return next((stamp_ns for stamp_ns in stamps_ns if stamp_ns), 0)

    def last_clocks(self) -> NDArray[np.int64]:
        """Return the clocks of the watched processes at each step of the last playback.

        Returns:
            Processor times in nanoseconds, steps × processes, and -1 of a process that had ended.
        """
        self._find_playbacks()
        return self._playbacks[-1].clocks() if self._playbacks else np.empty((0, 0), np.int64)

    def _find_playbacks(self) -> None:
        while (path := playback_path(self._path, len(self._playbacks) + 1)).exists():
            self._playbacks.append(_Playback(path))


class _Playback:
    """One file, mapped."""

    def __init__(self, path: Path) -> None:
        self._published = np.memmap(path, dtype="<i8", mode="r", shape=(1,))
        with path.open("rb") as file:
            _, _, count, *_, clocks = _HEADER.unpack(file.read(HEADER_BYTES))
        self._entries: Entries = np.empty(0, ENTRY_DTYPE)
        self._clocks: NDArray[np.int64] = np.empty((count, clocks), _CLOCK_DTYPE)
        if count:
            self._entries = np.memmap(
                path, dtype=ENTRY_DTYPE, mode="r", offset=HEADER_BYTES, shape=(count,)
            )
        if self._clocks.size:
            offset = HEADER_BYTES + count * ENTRY_DTYPE.itemsize
            self._clocks = np.memmap(
                path, dtype=_CLOCK_DTYPE, mode="r", offset=offset, shape=(count, clocks)
            )
        self._bounds: tuple[NDArray[np.int64], NDArray[np.int64]] | None = None

    def complete(self) -> int:
        published = int(self._published[0])
        return int(self._entries["complete"][published - 1]) if published else 0

    def last_stamp_ns(self) -> int:
        played = self._entries[: int(self._published[0])]
        stamps_ns: NDArray[np.int64] = played["stamp_ns"][played["step"] != NO_STEP]
        return int(stamps_ns.max(initial=0))

    def clocks(self) -> NDArray[np.int64]:
        first, _ = self._bounds_of_steps()
        return np.array(self._clocks[first[: self.complete()]])

    def _bounds_of_steps(self) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        if self._bounds is None:
            self._bounds = _first_and_last(self._entries["step"])
        return self._bounds

    def rows(self, start: int, stop: int, dtype: np.dtype[np.void]) -> NDArray[np.void]:
        first, last = (bound[start:stop] for bound in self._bounds_of_steps())
        begun = self._entries[first]
        row_array = np.empty(stop - start, dtype)
        for name in ("stamp_ns", "due_ns", "published_ns", "inputs"):
            row_array[name] = begun[name]
        row_array["done_ns"] = self._entries["done_ns"][last]
        return row_array


def _first_and_last(steps: NDArray[np.int32]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the first and the last entry of each step."""
    order = np.flatnonzero(steps != NO_STEP)
    if (np.diff(steps[order]) < 0).any():
        # Steps of a recording may overlap.
        order = order[np.argsort(steps[order], kind="stable")]
    numbers = np.arange(int(steps.max(initial=NO_STEP)) + 1)
    return (
        order[np.searchsorted(steps[order], numbers)],
        order[np.searchsorted(steps[order], numbers, side="right") - 1],
    )
