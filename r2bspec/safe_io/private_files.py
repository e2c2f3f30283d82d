"""Files and folders that no other user of the machine may read.

Temporary folders are locked by the process that has created them, and the lock ends with the
process, however that ends. The next process of this user that creates a temporary folder removes
those that no process has locked: not even a killed process leaves any.
"""

from __future__ import annotations

import atexit
import contextlib
import errno
import fcntl
import functools
import os
import uuid
from collections.abc import Iterator
from pathlib import Path
from typing import Final

PRIVATE_UMASK = 0o077
"""New files get the mode 0600, and new folders 0700."""

_replaced: list[int] = []
"""The umasks that `private_files` has put aside; the first is the user's."""

_SUFFIX: Final = ".held"
"""Of no folder of others, and of none that is removed in another way."""


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
    import tempfile

    parent = parent or Path(tempfile.gettempdir())
    _remove_abandoned(parent)
    folder, held = _made(kind, parent)
    try:
        yield folder
    finally:
        remove_folder(folder)
        os.close(held)


@functools.cache
def process_folder(kind: str) -> Path:
    """Create a private folder that lasts as long as this process.

    Raises:
        OSError: it cannot be made.
    """
    stack = contextlib.ExitStack()
    folder = stack.enter_context(temporary_folder(kind))
    maker = os.getpid()
    # What is forked ends with the same functions.
    atexit.register(lambda: stack.close() if os.getpid() == maker else None)
    return folder


def _made(kind: str, parent: Path) -> tuple[Path, int]:
    """Return a new folder, and the descriptor by which it is locked.

    Another process may remove it before it is locked: then the next one is made.
    """
    import tempfile

    while True:
        folder = Path(tempfile.mkdtemp(prefix=f"r2bspec-{kind}-", suffix=_SUFFIX, dir=parent))
        try:
            return folder, _locked(folder, fcntl.LOCK_EX)
        except FileNotFoundError:
            continue
        except OSError:
            remove_folder(folder)
            raise


def _locked(folder: Path, operation: int) -> int:
    """Return the descriptor by which a folder of this user is locked.

    Raises:
        FileNotFoundError: it was removed meanwhile.
        OSError: it is locked by another process, of another user, or none.
    """
    # Another user may have put a link here: what is opened is what is looked at.
    held = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW)
    try:
        if os.fstat(held).st_uid != os.geteuid():
            raise PermissionError(errno.EPERM, "it belongs to another user", str(folder))
        fcntl.flock(held, operation)
        folder.stat()
    except OSError:
        os.close(held)
        raise
    return held


def _remove_abandoned(parent: Path) -> None:
    """Remove the folders of processes that were killed."""
    for folder in parent.glob(f"r2bspec-*{_SUFFIX}"):
        with contextlib.suppress(OSError):
            held = _locked(folder, fcntl.LOCK_EX | fcntl.LOCK_NB)
            remove_folder(folder)
            os.close(held)


def remove_folder(folder: Path) -> None:
    """Remove a folder as far as that is possible.

    A build or a node may have left folders that can be neither read nor written, and folders nested
    deeper than a path may be long or Python may recurse.
    """
    import shutil

    with contextlib.suppress(RecursionError):
        shutil.rmtree(folder, ignore_errors=True)
    if folder.is_symlink() or not folder.is_dir():
        return
    waiting = [folder]
    while waiting:
        here = waiting.pop()
        with contextlib.suppress(OSError):
            here.chmod(0o700)
            for below in list(here.iterdir()):
                with contextlib.suppress(OSError):
                    if below.is_symlink() or not below.is_dir():
                        below.unlink()
                        continue
                    # A folder that may not be written cannot be moved.
                    below.chmod(0o700)
                    waiting.append(below.rename(folder / uuid.uuid4().hex))
            here.rmdir()
    with contextlib.suppress(OSError):
        folder.rmdir()
