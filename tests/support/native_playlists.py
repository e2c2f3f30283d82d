"""The files of players, as the native player reads them."""

from __future__ import annotations

import hashlib
import subprocess
from collections.abc import Sequence
from pathlib import Path
from types import TracebackType

import r2bspec.native
from r2bspec.native.build import build, find_ros

_NATIVE = Path(r2bspec.native.__file__).parent
SANITIZERS = ("-fsanitize=address,undefined", "-fno-sanitize-recover=all")


def player_without_ros(flags: Sequence[str] = ()) -> Path:
    """The program of ``player_without_ros.c``."""
    included = hashlib.sha256((_NATIVE / "player.c").read_bytes()).hexdigest()
    return build(
        "player_without_ros",
        [Path(__file__).with_name("player_without_ros.c")],
        find_ros(),
        kind="program",
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
