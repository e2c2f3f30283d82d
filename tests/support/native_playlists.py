"""The files of players, as the native player reads them."""

from __future__ import annotations

import subprocess
from collections.abc import Sequence
from pathlib import Path
from types import TracebackType

import r2bspec.native
from r2bspec.native.build import build
from r2bspec.native.ros_headers import find_ros

_NATIVE = Path(r2bspec.native.__file__).parent
SANITIZERS = ("-fsanitize=address,undefined", "-fno-sanitize-recover=all")


def playlist_reader(flags: Sequence[str] = ()) -> Path:
    """The program of ``playlist_reader.c``."""
    return build(
        "playlist_reader",
        [_NATIVE / "playlist.c", Path(__file__).with_name("playlist_reader.c")],
        find_ros(),
        kind="program",
        flags=(f"-I{_NATIVE}", "-fwrapv", *flags),
        libraries=(),
    )


class PlaylistReader:
    """Reads files of players one after another in one process."""

    def __init__(self, program: Path) -> None:
        self._process = subprocess.Popen(
            [program], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        )

    def __enter__(self) -> PlaylistReader:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._process.communicate(timeout=30)
        assert self._process.returncode == 0, "it crashed"

    def read(self, playlist: Path, playback: Path, buffers: Sequence[Path]) -> str:
        """``played N`` for N bytes of messages, or why a file was refused."""
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        print(playlist, playback, *buffers, file=self._process.stdin, flush=True)
        line = self._process.stdout.readline()
        assert line, "it crashed"
        return line.rstrip("\n")
