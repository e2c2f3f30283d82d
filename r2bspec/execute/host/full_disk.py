"""Whether the disk of a run folder is full, which makes nodes fail in ways of their own."""

from __future__ import annotations

import errno
import os
import tempfile
from pathlib import Path

_NEEDED_BYTES = 64 << 10
"""What a disk that is not full has room for; a node prints less at once."""

_FULL = frozenset({errno.ENOSPC, errno.EDQUOT})


def unwritable_log(folder: Path) -> Path | None:
    """The largest log of a run, if its disk has no room for more; else None.

    A node that cannot write its log may raise, exit or fall silent.
    """
    if _has_room(folder):
        return None
    logs = [each for each in (folder / "logs").rglob("*") if each.is_file()]
    return max(logs, key=lambda each: each.lstat().st_size, default=None)


def _has_room(folder: Path) -> bool:
    try:
        with tempfile.TemporaryFile(dir=folder) as file:
            os.posix_fallocate(file.fileno(), 0, _NEEDED_BYTES)
    except OSError as error:
        return error.errno not in _FULL
    return True
