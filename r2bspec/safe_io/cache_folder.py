"""The user's cache: programs, datasets and indexes of recordings that are kept between calls.

What is kept is believed, so a cache is used only where no other user can write to it. Any other is
passed over, and so is one that cannot be made.
"""

from __future__ import annotations

import os
from pathlib import Path

from r2bspec.safe_io.private_files import private_files, process_folder

passed_over: list[str] = []
"""What to tell the user about caches that this process does not use, a sentence each."""


class UnusableCacheError(OSError):
    """A cache that this process does not use; `strerror` says why."""

    def __init__(self, reason: str) -> None:
        super().__init__(reason)
        self.strerror = reason


def cache_path(kind: str) -> Path:
    """Return where one kind of what is kept lies: in ``$XDG_CACHE_HOME``, or in ``~/.cache``."""
    named = Path(os.environ.get("XDG_CACHE_HOME", ""))
    # Without a home, the tilde stays; `Path.expanduser` would raise.
    base = named if named.is_absolute() else Path(os.path.expanduser("~/.cache"))  # noqa: PTH111
    return base / "r2bspec" / kind


def cache_folder(kind: str) -> Path:
    """Make the folder of one kind of what is kept, without links.

    Raises:
        OSError: it cannot be made, or other users can write to it (`UnusableCacheError`).
    """
    folder = cache_path(kind)
    if not folder.is_absolute():
        raise UnusableCacheError("this user has no home folder")
    with private_files():
        folder.mkdir(parents=True, exist_ok=True)
    folder = folder.resolve(strict=True)
    for place in (folder.parent, folder):
        status = place.stat()
        if status.st_uid not in {0, os.geteuid()}:
            raise UnusableCacheError(f"{place} belongs to another user")
        if status.st_mode & 0o022:
            raise UnusableCacheError(f"other users can write to {place}")
    return folder


def cache_or_temporary_folder(kind: str) -> Path:
    """Return the same, or in place of a cache that is not used a folder of this process."""
    try:
        return cache_folder(kind)
    except OSError as error:
        pass_over(kind, error)
        return process_folder(kind)


def pass_over(kind: str, error: OSError) -> None:
    """Let the user know, once, that a cache is not used."""
    text = (
        f"note: the cache {cache_path(kind)} is not used: {error.strerror or error}; each call "
        "makes anew what it would keep (XDG_CACHE_HOME names another folder)"
    )
    if text not in passed_over:
        passed_over.append(text)
