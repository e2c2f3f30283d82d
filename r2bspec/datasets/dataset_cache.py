"""The cache of synthetic datasets: entries are created atomically, once for all processes.

The messages of an entry are hashed before it is used. That it was found intact is remembered in
the cache with what the kernel says of its files: number, size, and the times of the last change of
content and of the file itself. While none of these changes, the entry is not hashed again.
"""

from __future__ import annotations

import os
import secrets
import shutil
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import msgspec

from r2bspec.bags.integrity import hash_content
from r2bspec.bags.recording import DataError, DatasetRecord
from r2bspec.safe_io.cache_folder import FileState, file_state

_SCRATCH_PREFIX = ".making-"
_LOCKS = ".locks"


KIND = "datasets"
"""The folder of datasets in the cache of the user."""


@contextmanager
def entry_lock(root: Path, name: str) -> Iterator[None]:
    """Hold the lock of an entry; waits while another process creates it.

    The kernel releases the lock when its process exits.

    Raises:
        DataError: the cache cannot be written (R2B311).
    """
    from filelock import FileLock

    with write_errors(root):
        (root / _LOCKS).mkdir(parents=True, exist_ok=True)
        lock = FileLock(root / _LOCKS / f"{name}.lock")
        lock.acquire()
    try:
        yield
    finally:
        lock.release()


@contextmanager
def new_entry(root: Path, name: str) -> Iterator[Path]:
    """A path for a new entry, which becomes the entry if the block succeeds.

    The caller holds the lock of the entry. If the block fails, its files are removed.

    Yields:
        A path that does not exist yet, named like the entry, on the same file system.
    """
    folder = root / f"{_SCRATCH_PREFIX}{name}"
    shutil.rmtree(folder, ignore_errors=True)
    try:
        with write_errors(root):
            folder.mkdir(parents=True)
        yield folder / name
        with write_errors(root):
            final = root / name
            if final.exists():
                # A damaged entry is moved away first, because only an empty folder can be replaced.
                final.rename(folder / "damaged")
            (folder / name).replace(final)
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def remove_stale_entries(root: Path, locked_name: str) -> None:
    """Remove incomplete entries of killed processes.

    A process holds the lock of its entry, so a free lock means that it has exited.

    Args:
        root: the cache.
        locked_name: the entry whose lock the caller holds; `new_entry` clears that one.
    """
    from filelock import FileLock, Timeout

    for folder in root.glob(f"{_SCRATCH_PREFIX}*"):
        name = folder.name.removeprefix(_SCRATCH_PREFIX)
        if name == locked_name:
            continue
        with (
            suppress(Timeout, OSError),
            FileLock(root / _LOCKS / f"{name}.lock", timeout=0),
        ):
            shutil.rmtree(folder, ignore_errors=True)


@contextmanager
def write_errors(root: Path) -> Iterator[None]:
    """Report a full or read-only disk as DataError (R2B311)."""
    import sqlite3

    try:
        yield
    except (OSError, sqlite3.Error) as error:
        errno = getattr(error, "errno", None)
        reason = str(error) if errno is None else os.strerror(errno)
        raise DataError(
            f"the dataset cannot be written to {root}: {reason}",
            code="R2B311",
            hint="free space on this disk, or select another folder with XDG_CACHE_HOME",
        ) from error


CHECKED_FOLDER = ".checked"


class CheckedEntry(msgspec.Struct, frozen=True, kw_only=True):
    """What was found when an entry was last hashed."""

    content_sha256: str
    files: dict[str, FileState]


def is_intact(root: Path, entry: Path, record: DatasetRecord) -> bool:
    """Compare the messages of an entry with the hash in its record.

    Args:
        root: the cache.
        entry: a dataset in it, whose files have their sizes.
        record: of that dataset.
    """
    try:
        checked = CheckedEntry(content_sha256=record.content_sha256, files=_file_states(entry))
        if _remembered(root, entry.name) == checked:
            return True
        if hash_content(entry) != record.content_sha256:
            return False
    except (DataError, OSError):
        return False
    _remember(root, entry.name, checked)
    return True


def _file_states(entry: Path) -> dict[str, FileState]:
    return {file.name: file_state(file.lstat()) for file in entry.iterdir()}


def _remembered(root: Path, name: str) -> CheckedEntry | None:
    """What was found before; None if nothing was, or another user may have written it."""
    try:
        descriptor = os.open(_memory_path(root, name), os.O_RDONLY | os.O_NOFOLLOW | os.O_CLOEXEC)
    except OSError:
        return None
    with os.fdopen(descriptor, "rb") as file:
        if os.fstat(file.fileno()).st_uid != os.geteuid():
            return None
        with suppress(OSError, msgspec.MsgspecError):
            return msgspec.json.decode(file.read(), type=CheckedEntry)
    return None


def _remember(root: Path, name: str, checked: CheckedEntry) -> None:
    """Keep what was found; without room for it, the entry is hashed again next time."""
    path = _memory_path(root, name)
    scratch = path.with_name(f".{path.name}.{secrets.token_hex(4)}.tmp")
    with suppress(OSError):
        path.parent.mkdir(mode=0o700, exist_ok=True)
        flags = os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW | os.O_CLOEXEC
        try:
            with os.fdopen(os.open(scratch, flags, 0o600), "wb") as file:
                file.write(msgspec.json.encode(checked))
            scratch.replace(path)
        finally:
            scratch.unlink(missing_ok=True)


def _memory_path(root: Path, name: str) -> Path:
    return root / CHECKED_FOLDER / f"{name}.json"
