"""The logs of a run, truncated so that no process can fill the disk."""

from __future__ import annotations

import contextlib
import io
import os
import stat
import time
from pathlib import Path
from typing import BinaryIO

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
        for folder in self._folders:
            # A folder may not be there yet.
            with contextlib.suppress(OSError):
                self._keep_small_below(folder)

    def _keep_small_below(self, folder: Path) -> None:
        for where, _, names, descriptor in os.fwalk(folder):
            for name in names:
                with contextlib.suppress(OSError):
                    self._keep_small(Path(where, name), descriptor)

    def _keep_small(self, log: Path, folder: int) -> None:
        """Cut a log if it is too large and a file of its own: no link of either kind."""
        found = os.stat(log.name, dir_fd=folder, follow_symlinks=False)
        if found.st_size <= MAX_LOG_BYTES or not _is_own_file(found):
            return
        flags = os.O_RDWR | os.O_APPEND | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC
        with os.fdopen(os.open(log.name, flags, dir_fd=folder), "ab+", buffering=0) as file:
            # It may have been replaced since it was looked at.
            if _is_own_file(os.fstat(file.fileno())):
                self._truncate(log, file)

    def _truncate(self, log: Path, file: io.FileIO) -> None:
        size = file.seek(0, os.SEEK_END)
        file.seek(size - KEPT_TAIL_BYTES)
        tail = file.read(KEPT_TAIL_BYTES) or b""
        file.truncate(KEPT_HEAD_BYTES)
        # What earlier cuts took out is counted; their notes were cut out with the rest.
        self._removed_bytes[log] = (
            self._removed_bytes.get(log, 0) + size - KEPT_HEAD_BYTES - KEPT_TAIL_BYTES
        )
        file.write(_note(self._removed_bytes[log]) + tail)


def open_log(log: Path) -> BinaryIO:
    """Open a log for appending; no other user may read it, and a link in its place is refused.

    Raises:
        OSError: it cannot be opened.
    """
    flags = os.O_WRONLY | os.O_APPEND | os.O_CREAT | os.O_NOFOLLOW | os.O_CLOEXEC
    return os.fdopen(os.open(log, flags, 0o600), "ab")


def _is_own_file(found: os.stat_result) -> bool:
    return stat.S_ISREG(found.st_mode) and found.st_nlink == 1


def _note(cut_bytes: int) -> bytes:
    return f"\n[r2bspec removed {cut_bytes / 2**20:.1f} MiB of this log here]\n".encode()
