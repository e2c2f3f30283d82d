"""Playback files of players that are scripted."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from r2bspec.ipc.playback_file import (
    ENTRY_DTYPE,
    HEADER_BYTES,
    CyclicRound,
    playback_path,
    write_playback,
)

MOST_STEPS = 30_000


class ScriptedPlayback:
    """One playback of steps with one event each, which are written as a player does it."""

    def __init__(self, path: Path) -> None:
        one = np.zeros(1, ENTRY_DTYPE)
        one["complete"], one["inputs"], one["left"] = 1, -1, 1
        file = playback_path(path, 1)
        write_playback(file, CyclicRound(one, 1, np.zeros(1)), 1.0, MOST_STEPS)
        self._count = np.memmap(file, dtype="<i8", mode="r+", shape=(1,))
        self._events = np.memmap(file, dtype=ENTRY_DTYPE, mode="r+", offset=HEADER_BYTES)

    def append(self, stamp_ns: int, due_ns: int, published_ns: int, done_ns: int) -> None:
        """Publish one more step."""
        event = self._events[int(self._count[0]) :][:1]
        event["stamp_ns"], event["due_ns"] = stamp_ns, due_ns
        event["published_ns"], event["done_ns"] = published_ns, done_ns
        self._count[0] += 1
