"""Damaged files of a player are refused or played; nothing of them reaches beyond the files."""

from __future__ import annotations

import os
import random
import struct
import threading
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest

pytest.importorskip("rclpy")

from native_playlists import SANITIZERS, LonePlayer, player_without_ros
from r2bspec.ipc.buffers import BufferWriter, buffer_path
from r2bspec.ipc.playback_file import read_round, write_playback, write_playlist
from r2bspec.ipc.schedule import (
    BetweenMessage,
    CyclicSchedule,
    Schedule,
    TimelineMessage,
    TimelineSchedule,
    TimelineStep,
)
from r2bspec.native.build import BuildError

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
def player() -> Iterator[LonePlayer]:
    try:
        program = player_without_ros(SANITIZERS)
    except BuildError as error:
        if "san" in str(error):
            pytest.skip(f"the compiler has no sanitizers here: {error}")
        raise
    with LonePlayer(program) as made:
        yield made


@dataclass(frozen=True)
class Files:
    """What a player gets for one playback."""

    playlist: bytes
    playback: bytes
    buffers: tuple[Path, ...]


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> list[Files]:
    folder = tmp_path_factory.mktemp("buffers")
    topics = ["/a", "/b"]
    for topic in topics:
        writer = BufferWriter(folder, topic, "x/msg/Y", has_header=True)
        for number in range(3):
            writer.append(number, bytes(16))
        writer.close()
    found = []
    for number, schedule in enumerate(SCHEDULES):
        playlist, playback = folder / f"playlist-{number}", folder / f"playback-{number}"
        made = read_round(schedule, topics, [True, False], folder)
        write_playlist(playlist, made)
        write_playback(playback, made, 1e6, 4)
        buffers = tuple(buffer_path(folder, topic, "cdr") for topic in topics)
        found.append(Files(playlist.read_bytes(), playback.read_bytes(), buffers))
    return found


class Playing:
    """Plays files from bytes."""

    def __init__(self, player: LonePlayer, folder: Path) -> None:
        self._player = player
        self._playlist, self._playback = folder / "playlist", folder / "playback"

    def __call__(self, playlist: bytes, playback: bytes, buffers: tuple[Path, ...]) -> str:
        self._playlist.write_bytes(playlist)
        self._playback.write_bytes(playback)
        return self._player.play(self._playlist, self._playback, buffers)


@pytest.fixture
def playing(player: LonePlayer, tmp_path: Path) -> Playing:
    return Playing(player, tmp_path)


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


def test_whole_ones_are_played(playing: Playing, files: list[Files]) -> None:
    # Steps and what is between them; in the recording, two rounds of three messages.
    played = [playing(each.playlist, each.playback, each.buffers) for each in files]
    assert played == [f"played 4: {16 * (4 + 3)} bytes", f"played 4: {16 * (3 + 3)} bytes"]


def test_a_truncated_one_is_refused(playing: Playing, files: list[Files]) -> None:
    for each in files:
        for size in range(0, len(each.playlist), 5):
            found = playing(each.playlist[:size], each.playback, each.buffers)
            assert "is damaged" in found
        for size in range(0, len(each.playback), 5):
            found = playing(each.playlist, each.playback[:size], each.buffers)
            assert "is damaged" in found


def test_a_source_that_the_player_does_not_have_is_refused(
    playing: Playing, files: list[Files]
) -> None:
    for each in files:
        found = playing(each.playlist, each.playback, each.buffers[:1])
        assert "is damaged" in found


def test_a_buffer_that_is_too_short_is_refused(
    playing: Playing, files: list[Files], tmp_path: Path
) -> None:
    short = tmp_path / "short"
    for size in (0, 15, 31):
        short.write_bytes(bytes(size))
        for each in files:
            found = playing(each.playlist, each.playback, (short, each.buffers[1]))
            assert "a buffer shorter than its index" in found


def test_damage_never_crashes_the_player(playing: Playing, files: list[Files]) -> None:
    chance = random.Random(13)  # noqa: S311 - damage that is the same each time
    ends = {"played": 0, "refused": 0}
    for number in range(ROUNDS):
        each = files[number % 2]
        in_playlist = chance.randrange(2)
        found = playing(
            damaged(each.playlist, chance) if in_playlist else each.playlist,
            each.playback if in_playlist else damaged(each.playback, chance),
            each.buffers,
        )
        ends["played" if found.startswith("played") else "refused"] += 1
    # Both happen, or the damage is not what it should be.
    assert min(ends.values()) > ROUNDS / 100, ends


def test_a_file_that_changes_while_it_is_played_never_crashes_the_player(
    playing: Playing, files: list[Files], tmp_path: Path
) -> None:
    chance = random.Random(17)  # noqa: S311 - damage that is the same each time
    whole = files[0]
    playing(whole.playlist, whole.playback, whole.buffers)
    ended = threading.Event()

    def damage() -> None:
        with (tmp_path / "playback").open("r+b", buffering=0) as file:
            while not ended.is_set():
                place = 8 * chance.randrange(len(whole.playback) // 8)
                os.pwrite(file.fileno(), struct.pack("<q", chance.choice(INTERESTING)), place)

    thread = threading.Thread(target=damage)
    thread.start()
    try:
        for _ in range(100):
            said = playing(whole.playlist, whole.playback, whole.buffers)
            assert "played" in said or "damaged" in said
    finally:
        ended.set()
        thread.join()
