"""The lock that makes a run folder belong to one run."""

from __future__ import annotations

import contextlib
import fcntl
import os
import weakref
from pathlib import Path

LOCK_FILE = ".lock"


class FolderLock:
    """A lock on a folder, held until `release`.

    It is the kernel's lock on a file in the folder, so it ends with the process that has it,
    whatever ends that. The file is removed with the lock.
    """

    def __init__(self, folder: Path) -> None:
        """Take the lock.

        Raises:
            BlockingIOError: another run has it.
            OSError: the file system refuses.
        """
        path = folder / LOCK_FILE
        flags = os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW | os.O_CLOEXEC
        descriptor = os.open(path, flags, 0o600)
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
            # The run that had it before may have removed the file after it was opened here.
            if not os.path.samestat(os.fstat(descriptor), path.lstat()):
                raise BlockingIOError
        except BaseException as error:
            os.close(descriptor)
            if isinstance(error, FileNotFoundError):
                raise BlockingIOError from error
            raise
        self._finalizer = weakref.finalize(self, _release, path, descriptor, os.getpid())

    def release(self) -> None:
        """Give the folder up; a second call does nothing."""
        self._finalizer()


def _release(path: Path, descriptor: int, owner: int) -> None:
    # A forked child has a copy of the lock, which is not its own.
    if os.getpid() == owner:
        with contextlib.suppress(OSError):
            path.unlink()
    with contextlib.suppress(OSError):
        os.close(descriptor)
