"""Files and folders that no other user of the machine may read.

A temporary folder ends with its block, or with its process. Those of killed processes are removed
a week later, by the next process of this user that makes one in the same place.
"""

from __future__ import annotations

import atexit
import contextlib
import functools
import os
import shutil
import stat
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Final

PRIVATE_UMASK = 0o077
"""New files get the mode 0600, and new folders 0700."""

_replaced: list[int] = []
"""The umasks that `private_files` has put aside; the first is the user's."""

_ABANDONED_S: Final = 7 * 24 * 3600.0
"""Longer than any run or comparison takes."""


@contextlib.contextmanager
def private_files() -> Iterator[None]:
    """Make everything that this process creates in the block unreadable to other users."""
    before = os.umask(PRIVATE_UMASK)
    _replaced.append(before)
    try:
        yield
    finally:
        _replaced.pop()
        os.umask(before)


def user_umask() -> int:
    """Return the umask that the user has chosen, for programs that create files of their own.

    -1: the same.
    """
    return _replaced[0] if _replaced else -1


@contextlib.contextmanager
def temporary_folder(kind: str, parent: Path | None = None) -> Iterator[Path]:
    """Create a folder for the block that no other user may read.

    Args:
        kind: what it is for, a part of its name.
        parent: in which it is made; ``$TMPDIR`` if None.

    Raises:
        OSError: it cannot be made.
    """
    folder = _made(kind, parent)
    try:
        yield folder
    finally:
        remove_folder(folder)


@functools.cache
def process_folder(kind: str) -> Path:
    """Create a private folder that lasts as long as this process.

    Raises:
        OSError: it cannot be made.
    """
    folder, maker = _made(kind), os.getpid()
    # What is forked ends with the same functions.
    atexit.register(lambda: remove_folder(folder) if os.getpid() == maker else None)
    return folder


def _made(kind: str, parent: Path | None = None) -> Path:
    import tempfile

    parent = parent or Path(tempfile.gettempdir())
    for folder in parent.glob("r2bspec-*.tmp"):
        with contextlib.suppress(OSError):
            status = folder.lstat()
            is_own = stat.S_ISDIR(status.st_mode) and status.st_uid == os.geteuid()
            if is_own and time.time() - status.st_mtime > _ABANDONED_S:
                remove_folder(folder)
    return Path(tempfile.mkdtemp(prefix=f"r2bspec-{kind}-", suffix=".tmp", dir=parent))


def remove_folder(folder: Path) -> None:
    """Remove a folder as far as that is possible; a link to a folder stays.

    A build or a node may have left folders that can be neither read nor written.
    """
    if folder.is_symlink():
        return
    for parent, folders, _ in os.walk(folder):
        for path in (Path(parent, name) for name in folders):
            with contextlib.suppress(OSError):
                if not path.is_symlink():
                    path.chmod(0o700)
    shutil.rmtree(folder, ignore_errors=True)
