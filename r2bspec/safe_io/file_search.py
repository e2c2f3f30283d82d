"""The search for files below a folder: within limits, on one file system, without loops."""

from __future__ import annotations

import contextlib
import fnmatch
import glob
import os
import re
from collections.abc import Iterator, Sequence
from itertools import islice
from pathlib import Path
from typing import Final

from r2bspec.diagnostics.quote import did_you_mean, quote
from r2bspec.errors import UsageError
from r2bspec.safe_io.limits import MAX_SEARCHED_ENTRIES, MAX_SEARCHED_FOLDERS
from r2bspec.safe_io.looked_up_files import is_noting, note_lookup
from r2bspec.safe_io.safe_file import is_there, names_if_any

_ANY_FOLDERS: Final = "**"
_MAX_NOTED: Final = 10_000
_MAX_FOLDERS_UP: Final = 3
_MAX_FOLDERS_BELOW: Final = 100


def matching_files(pattern: str) -> list[str]:
    """Return the files that match a pattern of the shell, sorted.

    ``*``, ``?`` and ``[...]`` stand for parts of a name, and ``**`` for any folders. They find no
    hidden names, and ``**`` follows no links.

    Raises:
        UsageError: very much would have to be searched.
    """
    parts = [part for part in pattern.split("/") if part]
    found = files_below("/" if pattern.startswith("/") else "", parts, pattern)
    return [file for file in found if os.path.isfile(file)]  # noqa: PTH113 - may be too long


def files_below(folder: str, parts: Sequence[str], searched: str) -> list[str]:
    """Return all but folders below a folder whose path matches the parts of a pattern, sorted.

    Pipes and links that lead nowhere are among them: a spec that is one gets a finding.

    Args:
        folder: where the search begins; empty for the current folder.
        parts: a pattern for each part of the path, as those of `matching_files`.
        searched: what the user named.

    Raises:
        UsageError: very much would have to be searched.
    """
    search = _Search(parts, searched)
    found: set[str] = set()
    pending = [(folder, 0, 0)]
    seen: set[tuple[str, int]] = set()
    while pending:
        place, depth, device = pending.pop()
        if depth == len(search.parts):
            if os.path.lexists(place) and not os.path.isdir(place):  # noqa: PTH112 - too long
                found.add(place)
        elif (place, depth) not in seen:
            seen.add((place, depth))
            pending += search.step(place, depth, device)
    return sorted(found)


def near_path(path: str | Path, base: Path = Path()) -> str:
    """Return a question with the path that may be meant by one that leads to nothing, if any.

    It is relative to another folder, above or below, or to the current one; or a name is misspelt.

    Args:
        path: relative to `base`.
        base: the folder of a spec, or the current folder.
    """
    if Path(path).is_absolute():
        meant = _similar(Path(path))
        return f"did you mean {quote(str(meant))}?" if meant is not None else ""
    above = (base.joinpath(*[".."] * up) for up in range(1, _MAX_FOLDERS_UP + 1))
    below = (base / name for name in names_if_any(base)[:_MAX_FOLDERS_BELOW])
    places = (folder / path for folder in (Path(), *above, *below))
    meant = next(filter(is_there, places), None) or _similar(base / path)
    if meant is None:
        return ""
    near = os.path.relpath(meant, base)
    dot = "./" if str(path).startswith("./") and not near.startswith(".") else ""
    return f"did you mean {quote(dot + near)}?"


def _similar(path: Path) -> Path | None:
    """Return a path that exists, and whose names are similar; None if there is none."""
    place = Path(path.anchor)
    for name in path.parts[len(place.parts) :]:
        if not is_there(place / name):
            name = did_you_mean(name, names_if_any(place))
            if not name:
                return None
        place /= name
    return place


def walk(folder: Path) -> Iterator[tuple[Path, list[str], list[str]]]:
    """As `os.walk`, which calls itself for each folder in another: of folders of any depth."""
    waiting = [folder]
    while waiting:
        parent = waiting.pop()
        folders: list[str] = []
        files: list[str] = []
        with contextlib.suppress(OSError), os.scandir(parent) as entries:
            for entry in entries:
                (folders if _is_folder(entry) else files).append(entry.name)
        yield parent, folders, files
        below = (parent / name for name in reversed(folders))
        waiting += (place for place in below if not os.path.islink(place))  # noqa: PTH114 - may be too long


def _is_folder(entry: os.DirEntry[str]) -> bool:
    try:
        return entry.is_dir()
    except OSError:
        return False


def regular_files(folder: Path) -> Iterator[Path]:
    """Return the regular files of a folder of any depth, and what links to such."""
    paths = (parent / name for parent, _, files in walk(folder) for name in files)
    return (path for path in paths if os.path.isfile(path))  # noqa: PTH113 - may be too long


def note_folder(folder: Path) -> None:
    """Take notice of a bag: of everything below a folder up to a number, or of a file."""
    if not is_noting():
        return
    note_lookup(folder)
    below = (
        parent / name for parent, folders, files in walk(folder) for name in (*folders, *files)
    )
    for path in islice(below, _MAX_NOTED):
        note_lookup(path)


class _Search:
    """The steps of one search.

    Attributes:
        parts: of the pattern; ``**`` is followed by another part.
    """

    def __init__(self, parts: Sequence[str], searched: str) -> None:
        self.parts: list[str] = []
        for part in parts:
            if part != _ANY_FOLDERS or self.parts[-1:] != [_ANY_FOLDERS]:
                self.parts.append(part)
        self.parts += ["*"] * (self.parts[-1:] == [_ANY_FOLDERS])
        self._searched = searched
        self._folders = self._entries = 0

    def step(self, place: str, depth: int, device: int) -> Iterator[tuple[str, int, int]]:
        """Yield what matches one part more: each with that number of parts, and its file system."""
        deep = self.parts[depth] == _ANY_FOLDERS
        part = self.parts[depth + deep]
        after = depth + deep + 1
        if not (deep or glob.has_magic(part)):
            yield os.path.join(place, part), after, 0  # noqa: PTH118 - as the user wrote it
            return
        device = device or _device(place)
        matches = re.compile(fnmatch.translate(part)).match
        for entry in self._listed(place):
            path = os.path.join(place, entry.name)  # noqa: PTH118
            hidden = entry.name.startswith(".")
            if deep and not hidden and _is_below(entry, device):
                yield path, depth, device
            if matches(entry.name) and hidden <= part.startswith("."):
                yield path, after, 0

    def _listed(self, place: str) -> Iterator[os.DirEntry[str]]:
        self._folders += 1
        self._check(self._folders, MAX_SEARCHED_FOLDERS, "folders")
        with contextlib.suppress(OSError), os.scandir(place or ".") as entries:
            for entry in entries:
                self._entries += 1
                self._check(self._entries, MAX_SEARCHED_ENTRIES, "files and folders")
                yield entry

    def _check(self, number: int, limit: int, what: str) -> None:
        if number > limit:
            raise UsageError(
                f"{self._searched!r} has more than {limit:,} {what}, too many to search",
                hint="Name the folder of the specs, or each spec.",
            )


def _device(folder: str) -> int:
    try:
        return os.stat(folder or ".").st_dev  # noqa: PTH116
    except OSError:
        return 0


def _is_below(entry: os.DirEntry[str], device: int) -> bool:
    try:
        return entry.is_dir(follow_symlinks=False) and entry.stat().st_dev == device
    except OSError:
        return False
