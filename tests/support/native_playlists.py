"""The events of playlists, as the native player sees them."""

from __future__ import annotations

import subprocess
from collections.abc import Sequence
from pathlib import Path
from types import TracebackType

import r2bspec.native
from r2bspec.ipc.schedule import Schedule
from r2bspec.native.build import build
from r2bspec.native.ros_headers import find_ros

_NATIVE = Path(r2bspec.native.__file__).parent
SANITIZERS = ("-fsanitize=address,undefined", "-fno-sanitize-recover=all")


def playlist_reader(flags: Sequence[str] = ()) -> Path:
    """The program of ``playlist_events.c``."""
    return build(
        "playlist_events",
        [_NATIVE / "schedule.c", Path(__file__).with_name("playlist_events.c")],
        find_ros(),
        kind="program",
        flags=(f"-I{_NATIVE}", "-fwrapv", *flags),
        libraries=("-lm",),
    )


class PlaylistReader:
    """Reads playlists one after another in one process."""

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

    def read(
        self,
        path: Path,
        sources: int,
        rate_hz: float,
        steps: int,
        *,
        first: int = 0,
        most: int = 10_000,
    ) -> tuple[list[str], str]:
        """The lines of the events, and the last line: ``end`` or why the file was refused."""
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self._process.stdin.write(f"{sources} {rate_hz!r} {steps} {first} {most} {path}\n")
        self._process.stdin.flush()
        lines = []
        for line in self._process.stdout:
            lines.append(line.rstrip("\n"))
            if not lines[-1][:1].lstrip("-").isdigit() and not lines[-1].startswith("-"):
                return lines[:-1], lines[-1]
        raise AssertionError("it crashed")


def expected_events(
    schedule: Schedule, offsets: Sequence[Sequence[int]], rate_hz: float, steps: int, first: int
) -> list[str]:
    """The lines for the events of Python; `offsets` are those of the messages of each source."""
    lines = []
    for event in schedule.events(rate_hz, steps, first):
        shifts = event.stamp_offsets_ns or (0,) * len(event.messages)
        words: list[object] = [
            *(event.offset_ns, event.step, int(event.stamp_ns is not None), event.stamp_ns or 0),
            *(event.origin_ns, int(event.starts_step and event.step >= 0)),
            *(int(event.ends_step and event.step >= 0), event.inputs),
        ]
        words += [
            f"{source}:{offsets[source][position]}:{shift}"
            for (source, position), shift in zip(event.messages, shifts, strict=True)
        ]
        lines.append(" ".join(map(str, words)))
    return lines
