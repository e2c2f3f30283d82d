"""Whether the messages of a cached dataset are those that were made.

The messages are hashed before a dataset is used. That an entry was found intact is remembered in
the cache with what the kernel says of its files: number, size, and the times of the last change of
content and of the file itself. While none of these changes, the entry is not hashed again.
"""

from __future__ import annotations

import os
import secrets
from contextlib import suppress
from pathlib import Path

import msgspec

from r2bspec.bags.dataset_record import DatasetRecord
from r2bspec.bags.digest import hash_content
from r2bspec.bags.errors import DataError

CHECKED_FOLDER = ".checked"

FileState = tuple[int, int, int, int]
"""Inode, size, and when content (mtime) and file (ctime) last changed, in nanoseconds.

A program can set the first time to any value, but not the second."""


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
        found = CheckedEntry(content_sha256=record.content_sha256, files=_file_states(entry))
        if _remembered(root, entry.name) == found:
            return True
        if hash_content(entry) != record.content_sha256:
            return False
    except (DataError, OSError):
        return False
    _remember(root, entry.name, found)
    return True


def _file_states(entry: Path) -> dict[str, FileState]:
    states = {each.name: each.lstat() for each in entry.iterdir()}
    return {
        name: (each.st_ino, each.st_size, each.st_mtime_ns, each.st_ctime_ns)
        for name, each in states.items()
    }


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


def _remember(root: Path, name: str, found: CheckedEntry) -> None:
    """Keep what was found; without room for it, the entry is hashed again next time."""
    path = _memory_path(root, name)
    scratch = path.with_name(f".{path.name}.{secrets.token_hex(4)}.tmp")
    with suppress(OSError):
        path.parent.mkdir(mode=0o700, exist_ok=True)
        flags = os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW | os.O_CLOEXEC
        try:
            with os.fdopen(os.open(scratch, flags, 0o600), "wb") as file:
                file.write(msgspec.json.encode(found))
            scratch.replace(path)
        finally:
            scratch.unlink(missing_ok=True)


def _memory_path(root: Path, name: str) -> Path:
    return root / CHECKED_FOLDER / f"{name}.json"
