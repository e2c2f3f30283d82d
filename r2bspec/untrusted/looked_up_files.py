"""What a check looked up on this machine, so that it can be made again when that has changed.

Every access to a file, to a folder or to a variable of the environment is noted here before it is
made. `shared_lookups` answers a question about the machine once for many documents; what the
answer depends on is then noted for each of them.
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
    """What was looked up.

    Attributes:
        files: files and folders by their absolute paths, as they were at the first time.
        variables: variables of the environment by name; None if not set.
        read: the paths of files of which the content was read.
        complete: whether that is all that the result depends on.
    """

    files: dict[str, Stamp] = msgspec.field(default_factory=dict)
    variables: dict[str, str | None] = msgspec.field(default_factory=dict)
    read: set[str] = msgspec.field(default_factory=set)
    complete: bool = True
    _added: dict[int, Lookups] = msgspec.field(default_factory=dict)

    def add(self, other: Lookups) -> None:
        """Add what was looked up elsewhere; what is known here already stays."""
        if id(other) not in self._added:
            self._added[id(other)] = other
            self.files = other.files | self.files
            self.variables = other.variables | self.variables
            self.read |= other.read
            self.complete = self.complete and other.complete


_LOOKED_UP: Final[ContextVar[Lookups | None]] = ContextVar("looked_up", default=None)
_SHARED: Final[ContextVar[dict[Any, tuple[Any, Lookups]] | None]] = ContextVar(
    "shared", default=None
)


@contextlib.contextmanager
def looked_up_files() -> Iterator[Lookups]:
    """Within this context, everything that is looked up is added."""
    found = Lookups()
    with _noting(found):
        yield found


@contextlib.contextmanager
def shared_lookups() -> Iterator[None]:
    """Within this context, functions with `shared_lookup` are called once for each argument."""
    token = _SHARED.set({})
    try:
        yield
    finally:
        _SHARED.reset(token)


def shared_lookup(function: Callable[P, R]) -> Callable[P, R]:
    """Let many checks share the answers of a function that looks up files or variables.

    Its arguments must be hashable, and nothing may change its result. Exceptions are not shared.
    """

    @wraps(function)
    def ask(*args: P.args, **kwargs: P.kwargs) -> R:
        answers = _SHARED.get()
        if answers is None:
            return function(*args, **kwargs)
        question = (function, args, *kwargs.items())
        known = answers.get(question)
        if known is None:
            seen = Lookups()
            try:
                with _noting(seen):
                    known = answers[question] = function(*args, **kwargs), seen
            finally:
                _note_all(seen)
        else:
            _note_all(known[1])
        value: R = known[0]
        return value

    return ask


def note_lookup(path: Path) -> None:
    """Take notice of a file or a folder before it is opened or looked for."""
    found = _LOOKED_UP.get()
    if found is not None:
        place = str(path.absolute())
        if place not in found.files:
            found.files[place] = stamp(place)


def note_folder(folder: Path, max_files: int = 10_000) -> None:
    """Take notice of everything below a folder, or of a file; of too much, of not all."""
    found = _LOOKED_UP.get()
    if found is None:
        return
    note_lookup(folder)
    for parent, folders, files in os.walk(folder):
        max_files -= len(folders) + len(files)
        if max_files < 0:
            found.complete = False
            return
        for name in (*folders, *files):
            note_lookup(Path(parent, name))


def note_read(path: Path) -> None:
    """Take notice that the content of a file is read, which was looked up before."""
    found = _LOOKED_UP.get()
    if found is not None:
        found.read.add(str(path.absolute()))


def environment_variable(name: str) -> str | None:
    """A variable of the environment, of which notice is taken; None if it is not set."""
    value = os.environ.get(name)
    note_variable(name, value)
    return value


def note_variable(name: str, value: str | None) -> None:
    """Take notice of a variable of the environment that was read."""
    found = _LOOKED_UP.get()
    if found is not None:
        found.variables.setdefault(name, value)


def stamp(path: str | Path) -> Stamp:
    """What changes with a file."""
    try:
        status = os.stat(path)  # noqa: PTH116 - faster, and a path that cannot be is no file
    except (OSError, ValueError):
        return None
    return status.st_mtime_ns, status.st_size, status.st_ino, status.st_ctime_ns


@contextlib.contextmanager
def _noting(found: Lookups) -> Iterator[None]:
    token = _LOOKED_UP.set(found)
    try:
        yield
    finally:
        _LOOKED_UP.reset(token)


def _note_all(seen: Lookups) -> None:
    found = _LOOKED_UP.get()
    if found is not None:
        found.add(seen)
