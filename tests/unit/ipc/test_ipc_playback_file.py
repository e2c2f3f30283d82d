"""What a player has played is read as rows of steps, while it plays and over all its playbacks."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from r2bspec.ipc.playback_file import (
    ENTRY_DTYPE,
    HEADER_BYTES,
    CyclicRound,
    PlaybackReader,
    Round,
    TimelineRound,
    playback_path,
    write_playback,
)
from r2bspec.ipc.playback_file import complete_steps as complete
from r2bspec.record.sample_arrays import PLAYBACK_FIELDS

# The first step of two messages begins before the second one, and ends after it; transforms.
OVERLAPPING = [0, -1, 1, 0, 2]


def entries(steps: list[int]) -> Any:
    found = np.zeros(len(steps), ENTRY_DTYPE)
    found["step"] = steps
    found["complete"] = complete(found["step"])
    found["due_ns"] = 10 * np.arange(len(steps))
    found["inputs"] = 3
    return found


class Player:
    """Writes into the files of its playbacks as a player does."""

    def __init__(self, folder: Path) -> None:
        self._path = folder / "played"
        self._files = 0

    def begin(self, made: Round, steps: int) -> None:
        self._files += 1
        path = playback_path(self._path, self._files)
        write_playback(path, made, 10.0, steps)
        self._count = np.memmap(path, dtype="<i8", mode="r+", shape=(1,))
        self._entries = np.memmap(path, dtype=ENTRY_DTYPE, mode="r+", offset=HEADER_BYTES)

    def publish(self) -> None:
        number = int(self._count[0])
        event = self._entries[number : number + 1]
        event["published_ns"] = event["due_ns"] + 1
        event["done_ns"] = event["due_ns"] + 2
        event["stamp_ns"] = 100 * self._files + number
        self._count[0] += 1

    def reader(self) -> PlaybackReader:
        return PlaybackReader(self._path, PLAYBACK_FIELDS)


def timeline(steps: list[int]) -> TimelineRound:
    return TimelineRound(entries(steps), max(steps) + 1, period_ns=1000, stamp_period_ns=500)


def test_a_step_counts_when_it_and_all_before_it_are_complete(tmp_path: Path) -> None:
    player = Player(tmp_path)
    rows = player.reader()
    assert rows.count() == 0
    assert rows.read().size == 0
    player.begin(timeline(OVERLAPPING), 6)
    counts = [rows.count()]
    for _ in range(10):
        player.publish()
        counts.append(rows.count())
    assert counts == [0, 0, 0, 0, 2, 3, 3, 3, 3, 5, 6]
    found = rows.read()
    assert found["due_ns"].tolist() == [0, 20, 40, 1000, 1020, 1040]
    assert (found["published_ns"] - found["due_ns"]).tolist() == [1] * 6
    # The last message of a step ends it.
    assert (found["done_ns"] - found["due_ns"]).tolist() == [32, 2, 2] * 2
    assert found["stamp_ns"].tolist() == [100, 102, 104, 105, 107, 109]
    assert set(found["inputs"]) == {3}


def test_steps_of_all_playbacks_are_one_sequence(tmp_path: Path) -> None:
    player = Player(tmp_path)
    rows = player.reader()
    made = CyclicRound(entries([0, 1]), 2, np.array([0.0, 1.0]))
    for published in (3, 0, 2):
        player.begin(made, 5)
        for _ in range(published):
            player.publish()
    assert rows.count() == 5
    whole = rows.read()
    assert whole["stamp_ns"].tolist() == [100, 101, 102, 300, 301]
    for start in range(7):
        for stop in (*range(7), None):
            assert rows.read(start, stop).tolist() == whole[start:stop].tolist()
    assert rows.last_stamp_ns() == 301
    # Another reader, and one that has not looked before, see the same.
    assert player.reader().read().tolist() == whole.tolist()


def test_no_stamp_of_an_earlier_playback_is_repeated(tmp_path: Path) -> None:
    made = timeline([-1, 0, 1])
    made.entries["stamp_ns"] = [-900, 7, -5]
    write_playback(tmp_path / "recorded", made, 0.0, 4, last_stamp_ns=100)
    cyclic = CyclicRound(entries([0]), 1, np.zeros(1))
    write_playback(tmp_path / "cyclic", cyclic, 1.0, 1, last_stamp_ns=100)
    # The earliest stamp of the recording is 5 ns before its beginning.
    for name, expected in (("recorded", [6, 1, 106]), ("cyclic", [1, 0, 101])):
        header = np.fromfile(tmp_path / name, dtype="<i8", count=6)
        assert header[[0, 3]].tolist() == [0, 1]
        assert header[[2, 4, 5]].tolist() == expected


def test_what_is_played_between_two_steps_stays_there_however_they_come(tmp_path: Path) -> None:
    between = entries([0, -1, 1, -1])
    made = CyclicRound(between, 2, np.array([0.0, 0.5, 1.0, 1.5]))
    write_playback(tmp_path / "played", made, 10.0, 4, delays_ns=(0, -90_000_000, 0, 0))
    found = np.memmap(tmp_path / "played", dtype=ENTRY_DTYPE, mode="r", offset=HEADER_BYTES)
    assert (found["due_ns"] / 1e6).tolist() == [0, 10, 10, 60, 200, 250, 300, 350]
