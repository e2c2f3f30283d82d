"""The logs of a run, which no process may fill the disk with."""

from __future__ import annotations

import contextlib
import os
import time
from collections.abc import Iterator
from pathlib import Path

MAX_LOG_BYTES = 32 << 20
"""A log that is larger is cut."""

KEPT_HEAD_BYTES = 8 << 20
KEPT_TAIL_BYTES = 8 << 20
"""What is kept of a log that is cut: how it began, and what came last."""

_PERIOD_S = 0.1


class LogLimiter:
    """Everything in the log folders of a run.

    Processes write to their logs directly, so that none ever waits for the controller to read
    what it prints. What is too much is cut out afterwards: each log is opened for appending, so
    that its writer goes on at the new end.
    """

    def __init__(self) -> None:
        self._folders: set[Path] = set()
        self._removed_bytes: dict[Path, int] = {}
        self._next_s = 0.0

    @property
    def truncated(self) -> list[Path]:
        """The logs of which something was cut out."""
        return sorted(self._removed_bytes)

    def watch(self, folder: Path) -> None:
        """Keep the logs in a folder small, and those in folders below it."""
        self._folders.add(folder)

    def truncate_large(self, *, now: bool = False) -> None:
        """Cut what has grown too large; looks at most every tenth of a second, unless told `now`.

        A log that cannot be cut stays as it is.
        """
        if not now and time.monotonic() < self._next_s:
            return
        self._next_s = time.monotonic() + _PERIOD_S
        for log in self._files():
            with contextlib.suppress(OSError):
                if log.stat().st_size > MAX_LOG_BYTES:
                    self._truncate(log)

    def _files(self) -> Iterator[Path]:
        for folder in self._folders:
            for where, _, names in os.walk(folder):
                yield from (Path(where, name) for name in names)

    def _truncate(self, log: Path) -> None:
        with log.open("ab+", buffering=0) as file:
            size = file.seek(0, os.SEEK_END)
            file.seek(size - KEPT_TAIL_BYTES)
            tail = file.read(KEPT_TAIL_BYTES) or b""
            file.truncate(KEPT_HEAD_BYTES)
            # What earlier cuts took out is counted; their notes were cut out with the rest.
            self._removed_bytes[log] = (
                self._removed_bytes.get(log, 0) + size - KEPT_HEAD_BYTES - KEPT_TAIL_BYTES
            )
            file.write(_note(self._removed_bytes[log]) + tail)


def _note(cut_bytes: int) -> bytes:
    return f"\n[r2bspec cut out {cut_bytes / 2**20:.1f} MiB of this log here]\n".encode()
