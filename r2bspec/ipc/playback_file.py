"""Playback files: what a player publishes when, and when it did so.

The controller writes a file for each playback, and the player (``player.c``) maps it, plays it, and
writes the times into it. A file has the entries (`r2bspec.ipc.playback_events.ENTRY_DTYPE`) after a
header, all little-endian::

    int64 published, magic "R2BPLAY4", int64 entries, is_loaded, has_stamps, least_ns

With `is_loaded` 0 nothing is played: the player loads these messages into memory.
`has_stamps` is 1 if the stamps of a recording are shifted to the beginning of the playback, which
is then given a system time of at least `least_ns`; otherwise this is the least stamp. Stamps of
earlier playbacks are not repeated in this way, although stamps may be ahead of the clock.
The first `published` entries are complete: the player writes them before it counts them, so that
this process can read while it plays, and after it was killed.
"""

from __future__ import annotations

import struct
from collections.abc import Iterable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from r2bspec.ipc.playback_events import ENTRY_DTYPE, Entries, Round, TimelineRound
from r2bspec.ipc.sample_files import named_errors
from r2bspec.ipc.schedule import NO_STEP

_MAGIC = b"R2BPLAY4"
_HEADER = struct.Struct("<q8s4q")
HEADER_BYTES = _HEADER.size


def playback_path(path: Path, number: int) -> Path:
    """The file of a playback; `number` counts from 1."""
    return path.with_name(f"{path.name}-{number}")


def write_playlist(path: Path, made: Round) -> None:
    """Write the file of all messages, which the player loads before it plays some of them.

    Raises:
        OSError: the disk is full; it has the name of the file.
    """
    _write(path, made.blocks(1.0, made.steps, 0), is_loaded=False, has_stamps=False, least_ns=0)


def write_playback(
    path: Path, made: Round, rate_hz: float, steps: int, first: int = 0, last_stamp_ns: int = 0
) -> None:
    """Write the file of a playback.

    Args:
        path: of the new file.
        made: one round of the schedule.
        rate_hz: steps per second; without effect on a recording, which has its own times.
        steps: how many.
        first: the step of the round to begin with; also without effect on a recording.
        last_stamp_ns: the last stamp of earlier playbacks.

    Raises:
        OSError: the disk is full; it has the name of the file.
    """
    has_stamps = isinstance(made, TimelineRound)
    least_ns = last_stamp_ns + 1
    if has_stamps:
        least_ns -= int(made.entries["stamp_ns"][made.entries["step"] != NO_STEP].min())
        first = 0
    blocks = made.blocks(rate_hz, steps, first)
    _write(path, blocks, is_loaded=True, has_stamps=has_stamps, least_ns=least_ns)


def _write(
    path: Path, blocks: Iterable[Entries], *, is_loaded: bool, has_stamps: bool, least_ns: int
) -> None:
    # Under its name it is complete, whatever happens.
    part = path.with_name(f".{path.name}.part")
    with named_errors(path), part.open("xb") as file:
        file.write(bytes(HEADER_BYTES))
        count = 0
        for block in blocks:
            file.write(block.data)
            count += block.size
        file.seek(0)
        file.write(_HEADER.pack(0, _MAGIC, count, is_loaded, has_stamps, least_ns))
    part.rename(path)


class PlaybackReader:
    """Reads the steps that a player has played so far, as one sequence over all its playbacks.

    A step is in it once it and all steps before it are complete. Its row has the stamp and the
    times of its first entry, and the end of its last one.

    Args:
        path: the files are ``PATH-1``, ``PATH-2`` and so on.
        fields: of a row, as `r2bspec.record.run_record.PLAYBACK_FIELDS`.
    """

    def __init__(self, path: Path, fields: tuple[tuple[str, str], ...]) -> None:
        self._path = path
        self._dtype = np.dtype(list(fields))
        self._playbacks: list[_Playback] = []

    def count(self) -> int:
        """The number of complete steps; 0 before the first playback."""
        self._find_playbacks()
        return sum(each.complete() for each in self._playbacks)

    def read(self, start: int = 0, stop: int | None = None) -> NDArray[np.void]:
        """The rows from `start` up to `stop`, or up to the last complete step."""
        self._find_playbacks()
        found = [np.empty(0, self._dtype)]
        begin = 0
        for each in self._playbacks:
            count = each.complete()
            last = count if stop is None else min(count, stop - begin)
            if last > max(0, start - begin):
                found.append(each.rows(max(0, start - begin), last, self._dtype))
            begin += count
        return np.concatenate(found)

    def last_stamp_ns(self) -> int:
        """The last stamp of a step that was played; 0 before the first one."""
        self._find_playbacks()
        # Stamps ascend from playback to playback.
        found = (each.last_stamp_ns() for each in reversed(self._playbacks))
        return next((each for each in found if each), 0)

    def _find_playbacks(self) -> None:
        while (path := playback_path(self._path, len(self._playbacks) + 1)).exists():
            self._playbacks.append(_Playback(path))


class _Playback:
    """One file, mapped."""

    def __init__(self, path: Path) -> None:
        self._published = np.memmap(path, dtype="<i8", mode="r", shape=(1,))
        count = (path.stat().st_size - HEADER_BYTES) // ENTRY_DTYPE.itemsize
        self._entries: Entries = np.empty(0, ENTRY_DTYPE)
        if count:
            self._entries = np.memmap(
                path, dtype=ENTRY_DTYPE, mode="r", offset=HEADER_BYTES, shape=(count,)
            )
        self._bounds: tuple[NDArray[np.int64], NDArray[np.int64]] | None = None

    def complete(self) -> int:
        published = int(self._published[0])
        return int(self._entries["complete"][published - 1]) if published else 0

    def last_stamp_ns(self) -> int:
        played = self._entries[: int(self._published[0])]
        stamps_ns: NDArray[np.int64] = played["stamp_ns"][played["step"] != NO_STEP]
        return int(stamps_ns.max(initial=0))

    def rows(self, start: int, stop: int, dtype: np.dtype[np.void]) -> NDArray[np.void]:
        if self._bounds is None:
            self._bounds = _first_and_last(self._entries["step"])
        first, last = (each[start:stop] for each in self._bounds)
        begun = self._entries[first]
        found = np.empty(stop - start, dtype)
        for name in ("stamp_ns", "due_ns", "published_ns", "inputs"):
            found[name] = begun[name]
        found["done_ns"] = self._entries["done_ns"][last]
        return found


def _first_and_last(steps: NDArray[np.int32]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """The first and the last entry of each step."""
    order = np.flatnonzero(steps != NO_STEP)
    if (np.diff(steps[order]) < 0).any():
        # Steps of a recording may overlap.
        order = order[np.argsort(steps[order], kind="stable")]
    numbers = np.arange(int(steps.max(initial=NO_STEP)) + 1)
    return (
        order[np.searchsorted(steps[order], numbers)],
        order[np.searchsorted(steps[order], numbers, side="right") - 1],
    )
