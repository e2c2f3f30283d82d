"""The ROS packages whose sources lie in a work tree, found by their ``package.xml``.

A program of such a package is known by its sources rather than by what was built of them: these
change with every path that a compiler wrote into a file, and a build may be older than the sources.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterator
from functools import cached_property
from pathlib import Path
from typing import Final

from r2bspec.untrusted.safe_file import is_regular, read_bytes

MANIFEST: Final = "package.xml"

_MAX_MANIFEST_BYTES: Final = 1_000_000
_MAX_DEPTH: Final = 6
_MAX_FOLDERS: Final = 5_000
_MAX_FILES: Final = 5_000
_NAME: Final = re.compile(rb"<name>\s*([A-Za-z0-9_-]+)\s*</name>")
_DEPENDENCY: Final = re.compile(
    rb"<(?:build_|exec_|run_|build_export_)?depend[^>]*>\s*([A-Za-z0-9_-]+)\s*<"
)
_MARKERS: Final = frozenset({"COLCON_IGNORE", "AMENT_IGNORE", "CATKIN_IGNORE"})
_NO_SOURCES: Final = frozenset({"build", "install", "log", "node_modules", "__pycache__"})
_NOT_RUN: Final = frozenset({"test", "tests", "doc", "docs", "__pycache__"})
_NOT_RUN_FILES: Final = re.compile(r"(?i)(readme|changelog|license|contributing).*|.*\.py[co]|\..*")


class WorkspacePackages:
    """The packages of one work tree, looked up when the first of them is asked for.

    Args:
        top: the top of the work tree.
    """

    def __init__(self, top: Path) -> None:
        self._top = top

    @cached_property
    def folders(self) -> dict[str, Path]:
        """The folders of the packages, by name."""
        packages: dict[str, Path] = {}
        waiting = [(str(self._top), 0)]
        visited = 0
        while waiting and visited < _MAX_FOLDERS:
            folder, depth = waiting.pop()
            visited += 1
            names, below = _entries(folder)
            if names & _MARKERS:
                continue
            if MANIFEST in names:
                if match := _NAME.search(_manifest(Path(folder))):
                    packages.setdefault(match[1].decode(), Path(folder))
            elif depth < _MAX_DEPTH:
                waiting += [(path, depth + 1) for path in below]
        return packages

    def sources(self, package: str) -> Iterator[Path]:
        """The files of a package, and of those of the work tree that it depends on.

        Tests and documents are left out: they are no part of what runs.
        """
        waiting, seen = [package], set[str]()
        while waiting:
            name = waiting.pop()
            folder = self.folders.get(name)
            if folder is None or name in seen:
                continue
            seen.add(name)
            yield from _files_of(folder)
            waiting += [each.decode() for each in _DEPENDENCY.findall(_manifest(folder))]

    def counterpart(self, package: str, inside: str) -> Path | None:
        """The source of an installed module of a package, by its path below the installation."""
        folder = self.folders.get(package)
        if folder is None:
            return None
        for path in (folder / inside, folder / "src" / inside):
            if is_regular(path):
                return path
        return None


def _entries(folder: str) -> tuple[set[str], list[str]]:
    """The names of the files of a folder, and the folders below it that may have packages."""
    names, below = set[str](), list[str]()
    try:
        with os.scandir(folder) as entries:
            for entry in entries:
                if not entry.is_dir(follow_symlinks=False):
                    names.add(entry.name)
                elif not entry.name.startswith(".") and entry.name not in _NO_SOURCES:
                    below.append(entry.path)
    except OSError:
        pass
    return names, sorted(below, reverse=True)


def _manifest(folder: Path) -> bytes:
    try:
        return read_bytes(folder / MANIFEST, max_bytes=_MAX_MANIFEST_BYTES)
    except (OSError, ValueError):
        return b""


def _files_of(folder: Path) -> Iterator[Path]:
    count = 0
    for parent, folders, files in os.walk(folder):
        folders[:] = sorted(
            name for name in folders if name not in _NOT_RUN and not name.startswith(".")
        )
        for name in sorted(files):
            if _NOT_RUN_FILES.fullmatch(name) is None:
                yield Path(parent, name)
                count += 1
                if count >= _MAX_FILES:
                    return
