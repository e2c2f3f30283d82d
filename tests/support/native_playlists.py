"""The files of players, as the native player reads them."""

from __future__ import annotations

import hashlib
import subprocess
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType

import r2bspec.native
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
from r2bspec.native.build import build, find_ros

_NATIVE = Path(r2bspec.native.__file__).parent
SANITIZERS = ("-fsanitize=address,undefined", "-fno-sanitize-recover=all")


def player_without_ros(flags: Sequence[str] = (), compiler: Sequence[str] | None = None) -> Path:
    """The program of ``player_without_ros.c``."""
    included = hashlib.sha256((_NATIVE / "player.c").read_bytes()).hexdigest()
    return build(
        "player_without_ros",
        [Path(__file__).with_name("player_without_ros.c")],
        find_ros(),
        kind="program",
        compiler=compiler,
        # What a source includes has to change the digest of the build.
        flags=(f"-I{_NATIVE}", f"-DINCLUDED={included}", "-fwrapv", *flags),
    )


class LonePlayer:
    """Plays files one after another in one process."""

    def __init__(self, program: Path) -> None:
        self._process = subprocess.Popen(
            [program], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        )

    def __enter__(self) -> LonePlayer:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._process.communicate(timeout=30)
        assert self._process.returncode == 0, "it crashed"

    def play(self, playlist: Path, playback: Path, buffers: Sequence[Path]) -> str:
        """``played N`` for N steps, or why a file was refused, and how much was published."""
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        print(playlist, playback, *buffers, file=self._process.stdin, flush=True)
        line = self._process.stdout.readline()
        assert line, "it crashed"
        return line.rstrip("\n")


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


@dataclass(frozen=True)
class PlaybackFiles:
    """What a player gets for one playback."""

    playlist: bytes
    playback: bytes
    buffers: tuple[Path, ...]


def playback_files(folder: Path) -> list[PlaybackFiles]:
    """Make files of `SCHEDULES` in a folder."""
    topics = ["/a", "/b"]
    for topic in topics:
        writer = BufferWriter(folder, topic, "x/msg/Y", has_header=True)
        for number in range(3):
            writer.append(number, bytes(16))
        writer.close()
    files = []
    for number, schedule in enumerate(SCHEDULES):
        playlist, playback = folder / f"playlist-{number}", folder / f"playback-{number}"
        playback_round = read_round(schedule, topics, [True, False], folder)
        write_playlist(playlist, playback_round)
        write_playback(playback, playback_round, 1e6, 4)
        buffers = tuple(buffer_path(folder, topic, "cdr") for topic in topics)
        files.append(PlaybackFiles(playlist.read_bytes(), playback.read_bytes(), buffers))
    return files
