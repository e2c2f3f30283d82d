"""Damaged playlists are refused or played; nothing of them reaches beyond the file."""

from __future__ import annotations

import random
import struct
from collections.abc import Iterator
from pathlib import Path

import pytest

pytest.importorskip("rclpy")

from native_playlists import SANITIZERS, PlaylistReader, playlist_reader
from r2bspec.ipc.buffers import BufferWriter
from r2bspec.ipc.playlist import write_playlist
from r2bspec.ipc.schedule import (
    BetweenMessage,
    CyclicSchedule,
    Schedule,
    TimelineMessage,
    TimelineSchedule,
    TimelineStep,
)
from r2bspec.native.errors import BuildError

ROUNDS = 2_000
INTERESTING = (0, 1, -1, 7, 8, 1 << 31, 1 << 62, -(1 << 63), (1 << 63) - 1)
SCHEDULES: tuple[Schedule, ...] = (
    CyclicSchedule(
        steps=((0,), (1,), (2,)),
        columns=(0,),
        between=(BetweenMessage(0.5, 1, 0), BetweenMessage(1.75, 1, 1)),
        stamp_offsets_ns=((1,), (-2,), (3,)),
    ),
    TimelineSchedule(
        steps=(TimelineStep(5, 3), TimelineStep(9, 1)),
        messages=(
            TimelineMessage(0, 0, 0, 0),
            TimelineMessage(3, 1, 0, 1),
            TimelineMessage(4, 0, 1, 0),
        ),
        origin_ns=5,
        period_ns=10,
        stamp_period_ns=20,
        inputs=2,
    ),
)


@pytest.fixture(scope="module")
def reader() -> Iterator[PlaylistReader]:
    try:
        program = playlist_reader(SANITIZERS)
    except BuildError as error:
        if "san" in str(error):
            pytest.skip(f"the compiler has no sanitizers here: {error}")
        raise
    with PlaylistReader(program) as made:
        yield made


@pytest.fixture(scope="module")
def playlists(tmp_path_factory: pytest.TempPathFactory) -> list[bytes]:
    folder = tmp_path_factory.mktemp("buffers")
    for topic in ("/a", "/b"):
        writer = BufferWriter(folder, topic, "x/msg/Y", has_header=True)
        for number in range(3):
            writer.append(number, bytes(16))
        writer.close()
    found = []
    for number, schedule in enumerate(SCHEDULES):
        path = folder / f"playlist-{number}"
        write_playlist(path, schedule, ["/a", "/b"], folder)
        found.append(path.read_bytes())
    return found


def damaged(whole: bytes, chance: random.Random) -> bytes:
    made = bytearray(whole)
    for _ in range(chance.randint(1, 4)):
        match chance.randrange(4):
            case 0:
                del made[chance.randrange(len(made) + 1) :]
            case 1:
                made += chance.randbytes(chance.randint(1, 64))
            case 2 if made:
                made[chance.randrange(len(made))] ^= 1 << chance.randrange(8)
            case _ if len(made) >= 8:
                place = 8 * chance.randrange(len(made) // 8)
                made[place : place + 8] = struct.pack("<q", chance.choice(INTERESTING))
    return bytes(made)


def test_whole_ones_are_played(
    reader: PlaylistReader, playlists: list[bytes], tmp_path: Path
) -> None:
    for whole in playlists:
        path = tmp_path / "playlist"
        path.write_bytes(whole)
        lines, last = reader.read(path, 3, 10.0, 4)
        assert last == "end"
        assert len(lines) >= 4


def test_a_truncated_one_is_refused(
    reader: PlaylistReader, playlists: list[bytes], tmp_path: Path
) -> None:
    path = tmp_path / "playlist"
    for whole in playlists:
        for size in range(0, len(whole), 5):
            path.write_bytes(whole[:size])
            assert "is not a playlist" in reader.read(path, 3, 10.0, 4)[1]


def test_a_source_that_the_player_does_not_have_is_refused(
    reader: PlaylistReader, playlists: list[bytes], tmp_path: Path
) -> None:
    path = tmp_path / "playlist"
    for whole in playlists:
        path.write_bytes(whole)
        assert "a message is not where it can be" in reader.read(path, 1, 10.0, 4)[1]


def test_damage_never_crashes_the_reader(
    reader: PlaylistReader, playlists: list[bytes], tmp_path: Path
) -> None:
    chance = random.Random(13)  # noqa: S311 - damage that is the same each time
    path = tmp_path / "playlist"
    ends = {"end": 0, "refused": 0}
    for number in range(ROUNDS):
        path.write_bytes(damaged(playlists[number % 2], chance))
        lines, last = reader.read(path, 3, 10.0, 5, most=200)
        assert len(lines) <= 200
        ends["end" if last == "end" else "refused"] += 1
    # Both happen, or the damage is not what it should be.
    assert min(ends.values()) > ROUNDS / 100, ends
