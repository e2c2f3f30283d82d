"""Files below a run folder: written whole or not at all, read with errors that name a remedy.

Also the lock by which a folder belongs to one run.
"""

from __future__ import annotations

import contextlib
import errno
import fcntl
import os
import weakref
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, TypeVar

import msgspec

from r2bspec.errors import ExitStatus, R2bspecError, is_refusal, refusal_hint
from r2bspec.safe_io.limits import MAX_JSON_BYTES
from r2bspec.safe_io.safe_file import is_regular, is_there, read_bytes
from r2bspec.safe_io.safe_json import decode_json, read_json

T = TypeVar("T")

RUN_UNREADABLE: Final = "R2B650"
RUN_UNWRITABLE: Final = "R2B651"


class RecordError(R2bspecError):
    """A run folder cannot be written or read.

    The message names the file; `hint` is the remedy.
    """

    code = RUN_UNREADABLE
    exit_code = ExitStatus.USAGE
    way_out = "See that you may read it, and that it is as r2bspec wrote it."


class FolderTakenError(RecordError):
    """The folder of a run is not empty, or belongs to another run."""

    code = RUN_UNWRITABLE


def write_atomically(path: Path, content: bytes) -> None:
    """Write a file so that other processes see the old or the new content, never a part.

    The content is written to a temporary file in the same folder, synchronised to the disk, and
    renamed to `path`; parent folders are created. A crash at any time leaves at most a hidden file
    whose name ends in ``.tmp``.

    Args:
        path: the file to write; replaced if it exists.
        content: the bytes.

    Raises:
        RecordError: the file cannot be written.
    """
    temporary = path.with_name(f".{path.name}.{os.urandom(4).hex()}.tmp")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with temporary.open("xb") as file:
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
        temporary.replace(path)
        _sync_folder(path.parent)
    except OSError as error:
        failure = RecordError(
            f"{path} cannot be written: {error.strerror or error}",
            hint=refusal_hint(error),
            code=RUN_UNWRITABLE,
        )
        if is_refusal(error) and error.errno != errno.EROFS:
            # Nothing is wrong with what the user named: with more room, the same call works.
            failure.exit_code = ExitStatus.RUN_FAILED
        raise failure from error
    finally:
        with contextlib.suppress(OSError):
            temporary.unlink(missing_ok=True)


def write_output(path: Path, content: bytes) -> None:
    """Write a file that a user has named: atomically, but directly into a pipe or a device.

    A rename would replace ``/dev/null`` if this user may do that.

    Raises:
        RecordError: it cannot be written.
    """
    if not is_there(path) or is_regular(path):
        write_atomically(path, content)
        return
    try:
        path.write_bytes(content)
    except OSError as error:
        raise RecordError(
            f"{path} cannot be written: {error.strerror or error}",
            hint="Give the name of a file in a folder that you can write to.",
            code=RUN_UNWRITABLE,
        ) from error


def _sync_folder(folder: Path) -> None:
    """Synchronise a rename in `folder` to the disk, if the file system supports it."""
    with contextlib.suppress(OSError):
        descriptor = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(descriptor)
        finally:
            os.close(descriptor)


def to_json(value: Any) -> bytes:
    """Return the content of a JSON file in a run folder."""
    return msgspec.json.format(msgspec.json.encode(value), indent=1) + b"\n"


@dataclass(frozen=True)
class FolderReader:
    """Reads the JSON files of a stored run or comparison.

    Attributes:
        what: a ``run`` or a ``comparison``.
        incomplete: what to do if a file cannot be read.
    """

    what: str
    incomplete: str

    @property
    def changed(self) -> str:
        """The hint for a damaged file."""
        return f"The folder was changed after the {self.what}, or was not written by r2bspec."

    def versioned(self, path: Path, kind: type[T], version_key: str, missing: str = "") -> T:
        """Return a file that states its format version, which is checked before anything else.

        Args:
            path: the file.
            kind: its type.
            version_key: the key with the version, which is 1.
            missing: the hint if the file cannot be read; `incomplete` if empty.

        Raises:
            RecordError: it cannot be read, is damaged, or has an unknown version.
        """
        content = self.content(path, missing)
        header = msgspec.defstruct("Header", [(version_key, int)])
        version = getattr(self._decode(path, content, header), version_key)
        if version != FORMAT_VERSION:
            raise RecordError(
                f"{path} has format version {version}; this r2bspec reads version {FORMAT_VERSION}",
                hint=f"Use the version of r2bspec that wrote the {self.what}, or a newer one.",
            )
        return self._decode(path, content, kind)

    def require_once(self, path: Path, what: str, names: Iterable[str]) -> None:
        """Check that a file lists each name once.

        Raises:
            RecordError: it lists one several times.
        """
        counts = Counter(names)
        twice = next((name for name, count in counts.items() if count > 1), None)
        if twice is not None:
            raise RecordError(
                f"{path} is damaged: it lists the {what} {twice!r} {counts[twice]:,} times",
                hint=self.changed,
            )

    def optional(self, path: Path, kind: type[T]) -> T | None:
        """Return a file that not every folder has; None without it.

        Raises:
            RecordError: it is damaged.
        """
        try:
            return read_json(path, kind)
        except FileNotFoundError:
            return None
        except (OSError, msgspec.DecodeError) as error:
            raise RecordError(f"{path} is damaged: {error}", hint=self.changed) from error

    def content(self, path: Path, missing: str = "") -> bytes:
        """Return the content of a file; `missing` is as for `versioned`.

        Raises:
            RecordError: it cannot be read.
        """
        try:
            return read_bytes(path, max_bytes=MAX_JSON_BYTES)
        except OSError as error:
            raise RecordError(
                f"{path} cannot be read: {error.strerror or error}",
                hint=missing or self.incomplete,
            ) from error

    def _decode(self, path: Path, content: bytes, kind: type[T]) -> T:
        try:
            return decode_json(content, kind)
        except msgspec.DecodeError as error:
            raise RecordError(f"{path} is damaged: {error}", hint=self.changed) from error


FORMAT_VERSION: Final = 1

RUN_FILES: Final = FolderReader("run", "The run folder is incomplete; run the benchmark again.")

LOCK_FILE = ".lock"


class FolderLock:
    """A lock on a folder, held until `release`.

    It is a kernel lock on a file in the folder, so it ends with the process that holds it, however
    that ends. The file is removed with the lock.
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
        """Release the folder; a second call does nothing."""
        self._finalizer()


def _release(path: Path, descriptor: int, owner: int) -> None:
    # A forked child has a copy of the lock, which is not its own.
    if os.getpid() == owner:
        with contextlib.suppress(OSError):
            path.unlink()
    with contextlib.suppress(OSError):
        os.close(descriptor)
