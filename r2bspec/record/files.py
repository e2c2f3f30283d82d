"""Writing below a run folder: whole files or none, a lock for one run, and the errors of both."""

from __future__ import annotations

import contextlib
import fcntl
import os
import weakref
from collections.abc import Callable
from pathlib import Path
from typing import BinaryIO, Final

from r2bspec.errors import R2bspecError
from r2bspec.exit_status import ExitStatus

RUN_UNREADABLE: Final = "R2B650"
RUN_UNWRITABLE: Final = "R2B651"


class RecordError(R2bspecError):
    """A run folder cannot be written or read.

    The message names the file; `hint` is the remedy.
    """

    code = RUN_UNREADABLE
    exit_code = ExitStatus.USAGE


class FolderTakenError(RecordError):
    """The folder of a run is not empty, or belongs to another run: nothing in it is this run's."""

    code = RUN_UNWRITABLE


def write_atomically(path: Path, content: bytes | Callable[[BinaryIO], object]) -> None:
    """Write a file so that other processes see the old or the new content, never a part.

    The content is written to a temporary file in the same folder, synchronised to the disk, and
    renamed to `path`; parent folders are created. A crash at any time leaves at most a hidden file
    whose name ends in ``.tmp``.

    Args:
        path: the file to write; replaced if it exists.
        content: the bytes, or a function that writes them to an open binary file.

    Raises:
        RecordError: the file cannot be written.
    """
    temporary = path.with_name(f".{path.name}.{os.urandom(4).hex()}.tmp")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with temporary.open("xb") as file:
            if callable(content):
                content(file)
            else:
                file.write(content)
            file.flush()
            os.fsync(file.fileno())
        temporary.replace(path)
        _sync_folder(path.parent)
    except OSError as error:
        raise RecordError(
            f"{path} cannot be written: {error.strerror or error}",
            hint="Choose another folder with --output, or free space on this disk.",
            code=RUN_UNWRITABLE,
        ) from error
    finally:
        with contextlib.suppress(OSError):
            temporary.unlink(missing_ok=True)


def _sync_folder(folder: Path) -> None:
    """Synchronise a rename in `folder` to the disk, if the file system supports it."""
    with contextlib.suppress(OSError):
        descriptor = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(descriptor)
        finally:
            os.close(descriptor)


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
