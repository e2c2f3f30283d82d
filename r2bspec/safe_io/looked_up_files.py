"""The files and folders that a check looked up, and answers about the machine that checks share.

The functions of `safe_file` note each path here before they use it. `shared_lookups` answers a
question about the machine once for many documents; what the answer depends on is then noted for
each of them.
"""

from __future__ import annotations

import contextlib
import os
from collections.abc import Callable, Iterator
from contextvars import ContextVar
from functools import wraps
from pathlib import Path
from typing import Any, Final, ParamSpec, TypeVar

import msgspec

Stamp = tuple[int, int, int, int] | None
"""Modification time in nanoseconds, size in bytes, inode and change time in nanoseconds of a file
or a folder; None if there is none. No program can set the change time."""

P = ParamSpec("P")
R = TypeVar("R")


class Lookups(msgspec.Struct):
    """The paths that were looked up.

    Attributes:
        files: files and folders by their absolute paths, as they were at the first time.
        read: the paths of files of which the content was read.
    """

    files: dict[str, Stamp] = msgspec.field(default_factory=dict)
    read: set[str] = msgspec.field(default_factory=set)

    def add(self, other: Lookups) -> None:
        """Add what was looked up elsewhere; known entries stay."""
        self.files = other.files | self.files
        self.read |= other.read


_LOOKED_UP: Final[ContextVar[Lookups | None]] = ContextVar("looked_up", default=None)
_SHARED: Final[ContextVar[dict[Any, tuple[Any, Lookups]] | None]] = ContextVar(
    "shared", default=None
)


@contextlib.contextmanager
def looked_up_files() -> Iterator[Lookups]:
    """Collect everything that is looked up in the block."""
    lookups = Lookups()
    token = _LOOKED_UP.set(lookups)
    try:
        yield lookups
    finally:
        _LOOKED_UP.reset(token)


@contextlib.contextmanager
def shared_lookups() -> Iterator[None]:
    """Call functions with `shared_lookup` once for each argument in the block."""
    token = _SHARED.set({})
    try:
        yield
    finally:
        _SHARED.reset(token)


def shared_lookup(function: Callable[P, R]) -> Callable[P, R]:
    """Let many checks share the answers of a function that looks up files.

    Its arguments must be hashable, and nothing may change its result. Exceptions are not shared.
    """

    @wraps(function)
    def ask(*args: P.args, **kwargs: P.kwargs) -> R:
        answers = _SHARED.get()
        if answers is None:
            return function(*args, **kwargs)
        question = (function, args, *kwargs.items())
        if question not in answers:
            answers[question] = _noted(lambda: function(*args, **kwargs))
        elif (noting := _LOOKED_UP.get()) is not None:
            noting.add(answers[question][1])
        answer: R = answers[question][0]
        return answer

    return ask


def _noted(ask: Callable[[], R]) -> tuple[R, Lookups]:
    """Return an answer, and the lookups that it depends on if lookups are noted now."""
    noting = _LOOKED_UP.get()
    if noting is None:
        return ask(), Lookups()
    lookups = Lookups()
    try:
        with looked_up_files() as lookups:
            return ask(), lookups
    finally:
        noting.add(lookups)


def is_noting() -> bool:
    """Return True if lookups are noted now (`looked_up_files`)."""
    return _LOOKED_UP.get() is not None


def note_lookup(path: Path) -> None:
    """Note a file or a folder before it is opened or looked for."""
    noting = _LOOKED_UP.get()
    if noting is not None:
        place = str(path.absolute())
        if place not in noting.files:
            noting.files[place] = stamp(place)


def note_read(path: Path) -> None:
    """Note that the content of a file is read, which was looked up before."""
    noting = _LOOKED_UP.get()
    if noting is not None:
        noting.read.add(str(path.absolute()))


def stamp(path: str | Path) -> Stamp:
    """Return a value that changes with a file."""
    try:
        status = os.stat(path)  # noqa: PTH116 - faster, and a path that cannot be is no file
    except (OSError, ValueError):
        return None
    return status.st_mtime_ns, status.st_size, status.st_ino, status.st_ctime_ns
