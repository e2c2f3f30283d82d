"""Damaged files of a player are refused or played; nothing of them reaches beyond the files."""

from __future__ import annotations

import os
import random
import struct
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest

pytest.importorskip("rclpy")


from native_playlists import (
    SANITIZERS,
    LonePlayer,
    PlaybackFiles,
    playback_files,
    player_without_ros,
)
from r2bspec.native.build import BuildError

NUMBERS = (0, -1, 255, (1 << 31) - 1, -(1 << 31), 1 << 32, (1 << 63) - 1)


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


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> list[PlaybackFiles]:
    return playback_files(tmp_path_factory.mktemp("buffers"))


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


def test_whole_ones_are_played(playing: Playing, files: list[PlaybackFiles]) -> None:
    # Steps and what is between them; in the recording, two rounds of three messages.
    played = [playing(file.playlist, file.playback, file.buffers) for file in files]
    assert played == [f"played 4: {16 * (4 + 3)} bytes", f"played 4: {16 * (3 + 3)} bytes"]


def test_a_truncated_one_is_refused(playing: Playing, files: list[PlaybackFiles]) -> None:
    for file in files:
        for size in range(0, len(file.playlist), 5):
            found = playing(file.playlist[:size], file.playback, file.buffers)
            assert "is damaged" in found
        for size in range(0, len(file.playback), 5):
            found = playing(file.playlist, file.playback[:size], file.buffers)
            assert "is damaged" in found


def test_a_source_that_the_player_does_not_have_is_refused(
    playing: Playing, files: list[PlaybackFiles]
) -> None:
    for file in files:
        found = playing(file.playlist, file.playback, file.buffers[:1])
        assert "is damaged" in found


def test_a_buffer_that_is_too_short_is_refused(
    playing: Playing, files: list[PlaybackFiles], tmp_path: Path
) -> None:
    short = tmp_path / "short"
    for size in (0, 15, 31):
        short.write_bytes(bytes(size))
        for file in files:
            found = playing(file.playlist, file.playback, (short, file.buffers[1]))
            assert "a buffer shorter than its index" in found


def test_a_file_that_changes_while_it_is_played_never_crashes_the_player(
    playing: Playing, files: list[PlaybackFiles], tmp_path: Path
) -> None:
    chance = random.Random(17)  # noqa: S311 - damage that is the same each time
    whole = files[0]
    playing(whole.playlist, whole.playback, whole.buffers)
    ended = threading.Event()

    def damage() -> None:
        with (tmp_path / "playback").open("r+b", buffering=0) as file:
            while not ended.is_set():
                place = 8 * chance.randrange(len(whole.playback) // 8)
                os.pwrite(file.fileno(), struct.pack("<q", chance.choice(NUMBERS)), place)

    thread = threading.Thread(target=damage)
    thread.start()
    try:
        for _ in range(100):
            said = playing(whole.playlist, whole.playback, whole.buffers)
            assert "played" in said or "damaged" in said
    finally:
        ended.set()
        thread.join()
