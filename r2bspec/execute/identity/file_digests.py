"""Digests of files and of ROS packages, and the build ids of executables and libraries.

A build id is a note that the linker writes into an ELF file (``.note.gnu.build-id``): it stands for
the content, and reading it takes a few hundred bytes of a file of many megabytes.

A program of a package whose sources lie in a work tree is known by its sources rather than by what
was built of them: these change with every path that a compiler wrote into a file, and a build may
be older than the sources.
"""

from __future__ import annotations

import hashlib
import os
import re
import struct
from collections.abc import Iterator
from functools import cache, cached_property
from itertools import islice
from pathlib import Path
from typing import Final

from r2bspec.execute.processes.elf import DAMAGED, ELF, ElfFile, read_elf
from r2bspec.record.graph_identity import FileDigest
from r2bspec.safe_io.file_search import walk
from r2bspec.safe_io.limits import MAX_DIGEST_BYTES, MAX_MANIFEST_BYTES
from r2bspec.safe_io.safe_file import is_regular, open_regular, read_bytes

_NOTE_SEGMENT: Final = 4
"""PT_NOTE: it has notes of the linker."""

_BUILD_ID_NOTE: Final = 3


class FileDigests:
    """The digests of files of one run; each file is read once.

    Args:
        top: the folder that paths are relative to.
    """

    def __init__(self, top: Path) -> None:
        self._top = os.path.realpath(top)
        self._digests: dict[str, str] = {}
        self._real_folder = cache(os.path.realpath)

    def digest(self, path: Path) -> FileDigest | None:
        """The digest of a file; None if it cannot be read.

        Links are followed: a file that is linked into an installation has its name in the sources.
        """
        place = self.real_path(path)
        if place not in self._digests:
            try:
                self._digests[place] = file_sha256(Path(place))
            except OSError:
                return None
        return FileDigest(self.shown(place), self._digests[place])

    def real_path(self, path: Path) -> str:
        """A path without links; of the files of one folder, its links are resolved once."""
        folder, name = os.path.split(path)
        if name in {"", ".", ".."}:
            return os.path.realpath(path)
        place = os.path.join(self._real_folder(folder), name)  # noqa: PTH118 - for many files
        return os.path.realpath(place) if os.path.islink(place) else place  # noqa: PTH114

    def shown(self, place: str) -> str:
        """A path without links, as `FileDigest` has it."""
        inside = place.startswith(f"{self._top}/")
        return place[len(self._top) + 1 :] if inside else place

    def is_inside(self, path: Path) -> bool:
        """Whether a file is one of the work tree, after all links."""
        return self.real_path(path).startswith(f"{self._top}/")


def file_sha256(path: Path) -> str:
    """The digest of the content of a regular file.

    Raises:
        OSError: it is none, is larger than half a gigabyte, or cannot be read.
    """
    with open_regular(path) as file:
        if os.fstat(file.fileno()).st_size > MAX_DIGEST_BYTES:
            raise OSError(f"{path} is too large for a digest")
        return hashlib.file_digest(file, "sha256").hexdigest()  # type: ignore[arg-type]


def is_elf(path: Path) -> bool:
    """Whether a file is an executable or a library of this system."""
    try:
        with open_regular(path) as file:
            return file.read(len(ELF)) == ELF
    except OSError:
        return False


def build_id(path: Path) -> str:
    """The build id of an executable or a library; empty if the file cannot be read.

    A file without one has the digest of its content, with ``sha256:`` before it.
    """
    try:
        with open_regular(path) as file:
            try:
                note = _build_id_note(read_elf(file))
            except DAMAGED:
                note = ""
        return note or f"sha256:{file_sha256(path)}"
    except OSError:
        return ""


def _build_id_note(elf: ElfFile | None) -> str:
    """The note of the linker, in hexadecimal digits; empty without one."""
    if elf is None:
        return ""
    head = struct.Struct(f"{elf.order}III")
    for notes in elf.segments(_NOTE_SEGMENT):
        # Each note has the lengths of name and value, a type, and both, padded to four bytes.
        while len(notes) >= head.size:
            name_bytes, value_bytes, kind = head.unpack_from(notes)
            name = notes[head.size : head.size + name_bytes]
            value_at = head.size + (name_bytes + 3 & ~3)
            if kind == _BUILD_ID_NOTE and name == b"GNU\0":
                return notes[value_at : value_at + value_bytes].hex()
            notes = notes[value_at + (value_bytes + 3 & ~3) :]
    return ""


_MANIFEST: Final = "package.xml"

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
        for parent, folders, files in islice(walk(self._top), _MAX_FOLDERS):
            is_ignored = not _MARKERS.isdisjoint(files)
            if not is_ignored and _MANIFEST in files and (match := _NAME.search(_manifest(parent))):
                packages.setdefault(match[1].decode(), parent)
            depth = len(parent.relative_to(self._top).parts)
            if is_ignored or _MANIFEST in files or depth == _MAX_DEPTH:
                folders.clear()
            folders[:] = sorted(
                name for name in folders if not name.startswith(".") and name not in _NO_SOURCES
            )
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
            waiting += [match.decode() for match in _DEPENDENCY.findall(_manifest(folder))]

    def counterpart(self, package: str, inside: str) -> Path | None:
        """The source of an installed module of a package, by its path below the installation."""
        folder = self.folders.get(package)
        places = (folder / inside, folder / "src" / inside) if folder is not None else ()
        return next(filter(is_regular, places), None)


def _manifest(folder: Path) -> bytes:
    try:
        return read_bytes(folder / _MANIFEST, max_bytes=MAX_MANIFEST_BYTES)
    except (OSError, ValueError):
        return b""


def _files_of(folder: Path) -> Iterator[Path]:
    count = 0
    for parent, folders, files in walk(folder):
        folders[:] = sorted(
            name for name in folders if name not in _NOT_RUN and not name.startswith(".")
        )
        for name in sorted(files):
            if _NOT_RUN_FILES.fullmatch(name) is None:
                yield parent / name
                count += 1
                if count >= _MAX_FILES:
                    return
