"""Which files were looked up, so that a check can be made again when one of them has changed."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Iterator
from contextvars import ContextVar
from pathlib import Path
from typing import Final

Stamp = tuple[int, int, int] | None
"""Modification time in nanoseconds, size in bytes and inode of a file; None if there is none."""

_LOOKED_UP: Final[ContextVar[dict[Path, Stamp] | None]] = ContextVar("looked_up", default=None)


@contextlib.contextmanager
def looked_up_files() -> Iterator[dict[Path, Stamp]]:
    """Within this context, every file that is looked up is added, as it was at the first time."""
    found: dict[Path, Stamp] = {}
    token = _LOOKED_UP.set(found)
    try:
        yield found
    finally:
        _LOOKED_UP.reset(token)


def note_lookup(path: Path) -> None:
    """Take notice of a file before it is opened or looked for."""
    found = _LOOKED_UP.get()
    if found is not None:
        place = path.absolute()
        if place not in found:
            found[place] = stamp(place)


def stamp(path: Path) -> Stamp:
    """What changes with a file."""
    try:
        status = os.stat(path)  # noqa: PTH116 - faster, and a path that cannot be is no file
    except (OSError, ValueError):
        return None
    return status.st_mtime_ns, status.st_size, status.st_ino
