"""The logs of a run, truncated so that no process can fill the disk."""

from __future__ import annotations

import contextlib
import os
import time
from collections.abc import Iterator
from pathlib import Path

MAX_LOG_BYTES = 32 << 20
"""Larger logs are truncated."""

KEPT_HEAD_BYTES = 8 << 20
KEPT_TAIL_BYTES = 8 << 20
"""The parts of a truncated log that are kept: its beginning and its end."""

_PERIOD_S = 0.1


class LogLimiter:
    """Limits the size of all files in the log folders of a run.

    Processes write to their logs directly, so that none waits for the controller to read its
    output. The middle of a large log is removed later: each log is opened for appending, so that
    its process continues at the new end.
    """

    def __init__(self) -> None:
        self._folders: set[Path] = set()
        self._removed_bytes: dict[Path, int] = {}
        self._next_s = 0.0

    @property
    def truncated(self) -> list[Path]:
        """The logs that were truncated."""
        return sorted(self._removed_bytes)

    def watch(self, folder: Path) -> None:
        """Limit the logs in a folder and its subfolders."""
        self._folders.add(folder)

    def truncate_large(self, *, now: bool = False) -> None:
        """Truncate large logs; checks at most every tenth of a second, unless `now`.

        A log that cannot be truncated stays unchanged.
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
            # Includes the bytes removed earlier, whose note is removed now.
            self._removed_bytes[log] = (
                self._removed_bytes.get(log, 0) + size - KEPT_HEAD_BYTES - KEPT_TAIL_BYTES
            )
            file.write(_note(self._removed_bytes[log]) + tail)


def _note(cut_bytes: int) -> bytes:
    return f"\n[r2bspec removed {cut_bytes / 2**20:.1f} MiB of this log here]\n".encode()
