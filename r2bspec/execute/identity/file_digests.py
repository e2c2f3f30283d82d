"""Digests of files and of ROS packages, and the build ids of executables and libraries.

A build id is a note that the linker writes into an ELF file (``.note.gnu.build-id``): it stands for
the content, and reading it takes a few hundred bytes of a file of many megabytes.

A program of a package whose sources lie in a work tree is known by its sources rather than by what
was built of them: these change with every path that a compiler wrote into a file, and a build may
be older than the sources.
"""

from __future__ import annotations

import contextlib
import hashlib
import os
import re
import struct
from collections.abc import Iterator
from functools import cached_property
from pathlib import Path
from typing import BinaryIO, Final

from r2bspec.record.graph_identity import FileDigest
from r2bspec.safe_io.safe_file import is_regular, names_in, open_regular, read_bytes, read_listed

_MAX_DIGEST_BYTES: Final = 512_000_000
_MAX_NOTE_BYTES: Final = 65_536
_MAX_SEGMENTS: Final = 512
_BLOCK_BYTES: Final = 1 << 20

_ELF: Final = b"\x7fELF"
_PT_NOTE: Final = 4
_NT_GNU_BUILD_ID: Final = 3
_HEADERS: Final = {
    # The format after the identification, and that of an entry of the program header.
    1: ("HHIIIIIHHHHHH", "IIIIIIII"),
    2: ("HHIQQQIHHHHHH", "IIQQQQQQ"),
}


class FileDigests:
    """The digests of files of one run; each file is read once.

    Args:
        top: the folder that paths are relative to.
    """

    def __init__(self, top: Path) -> None:
        self._top = os.path.realpath(top)
        self._digests: dict[str, str] = {}
        self._real_folders: dict[str, str] = {}

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
        if folder not in self._real_folders:
            self._real_folders[folder] = os.path.realpath(folder)
        place = os.path.join(self._real_folders[folder], name)  # noqa: PTH118 - for many files
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
    digest = hashlib.sha256()
    with open_regular(path) as file:
        if os.fstat(file.fileno()).st_size > _MAX_DIGEST_BYTES:
            raise OSError(f"{path} is too large for a digest")
        while block := file.read(_BLOCK_BYTES):
            digest.update(block)
    return digest.hexdigest()


def is_elf(path: Path) -> bool:
    """Whether a file is an executable or a library of this system."""
    try:
        with open_regular(path) as file:
            return file.read(len(_ELF)) == _ELF
    except OSError:
        return False


def build_id(path: Path) -> str:
    """The build id of an executable or a library; empty if the file cannot be read.

    A file without one has the digest of its content, with ``sha256:`` before it.
    """
    try:
        with open_regular(path) as file:
            try:
                note = _build_id_note(file)
            except (struct.error, ValueError, OverflowError):
                note = ""
        return note or f"sha256:{file_sha256(path)}"
    except OSError:
        return ""


def _build_id_note(file: BinaryIO) -> str:
    """The note of the linker, in hexadecimal digits; empty without one.

    Raises:
        struct.error: the file ends too early.
        ValueError: an offset is none.
    """
    identification = file.read(16)
    if len(identification) < 16 or identification[:4] != _ELF or identification[4] not in _HEADERS:
        return ""
    order = "<" if identification[5] == 1 else ">"
    header, entry = (struct.Struct(order + each) for each in _HEADERS[identification[4]])
    fields = header.unpack(file.read(header.size))
    table, entry_bytes, count = fields[4], fields[8], fields[9]
    file.seek(table)
    entries = file.read(entry_bytes * min(count, _MAX_SEGMENTS))
    for start in range(0, len(entries), max(entry_bytes, 1)):
        segment = entry.unpack(entries[start : start + entry.size])
        # In files of 32 bits the flags come later.
        offset, size = (
            (segment[2], segment[5]) if identification[4] == 2 else (segment[1], segment[4])
        )
        if segment[0] == _PT_NOTE:
            file.seek(offset)
            found = _note_value(file.read(min(size, _MAX_NOTE_BYTES)), order)
            if found:
                return found
    return ""


def _note_value(notes: bytes, order: str) -> str:
    """The build id among notes: each has the lengths of name and value, a type, and both."""
    head = struct.Struct(f"{order}III")
    place = 0
    while place + head.size <= len(notes):
        name_bytes, value_bytes, kind = head.unpack_from(notes, place)
        value_at = place + head.size + _padded(name_bytes)
        name = notes[place + head.size : place + head.size + name_bytes]
        if kind == _NT_GNU_BUILD_ID and name == b"GNU\0":
            return notes[value_at : value_at + value_bytes].hex()
        place = value_at + _padded(value_bytes)
    return ""


def _padded(size: int) -> int:
    return (size + 3) & ~3


MANIFEST: Final = "package.xml"

_MAX_MANIFEST_BYTES: Final = 1_000_000
_MAX_DEPTH: Final = 6
_MAX_FOLDERS: Final = 5_000
_MAX_FILES: Final = 5_000
_INDEX: Final = "share/ament_index/resource_index"
_VERSION: Final = re.compile(rb"<version[^>]*>([^<]{1,100})</version>")
_NAME: Final = re.compile(rb"<name>\s*([A-Za-z0-9_-]+)\s*</name>")
_DEPENDENCY: Final = re.compile(
    rb"<(?:build_|exec_|run_|build_export_)?depend[^>]*>\s*([A-Za-z0-9_-]+)\s*<"
)
_MARKERS: Final = frozenset({"COLCON_IGNORE", "AMENT_IGNORE", "CATKIN_IGNORE"})
_NO_SOURCES: Final = frozenset({"build", "install", "log", "node_modules", "__pycache__"})
_NOT_RUN: Final = frozenset({"test", "tests", "doc", "docs", "__pycache__"})
_NOT_RUN_FILES: Final = re.compile(r"(?i)(readme|changelog|license|contributing).*|.*\.py[co]|\..*")


class InstalledPackages:
    """The ROS packages of ``AMENT_PREFIX_PATH``, each looked up once.

    Attributes:
        prefixes: where packages are installed, in the order in which they are searched.
    """

    def __init__(self) -> None:
        listed = os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep)
        self.prefixes = tuple(prefix for prefix in listed if prefix)
        self._found: dict[str, str] = {}

    def prefix(self, package: str) -> str:
        """Where a package is installed; empty if it is not."""
        if package not in self._found:
            self._found[package] = self.first_with(f"{_INDEX}/packages/{package}")
        return self._found[package]

    def first_with(self, inside: str) -> str:
        """The first prefix that has a file, by its path below the prefix; empty if none has."""
        # Without objects for paths: colcon gives each package of a workspace a prefix of its own.
        return next((each for each in self.prefixes if os.path.exists(f"{each}/{inside}")), "")  # noqa: PTH110

    @cached_property
    def names(self) -> frozenset[str]:
        """The names of all packages."""
        names: set[str] = set()
        for prefix in self.prefixes:
            with contextlib.suppress(OSError):
                names.update(names_in(Path(prefix, _INDEX, "packages")))
        return frozenset(names)

    def share(self, package: str) -> Path | None:
        """The share folder of a package; None if it is not installed."""
        prefix = self.prefix(package)
        return Path(prefix, "share", package) if prefix else None

    def version(self, package: str) -> str:
        """The version of a package; empty if it is not known."""
        share = self.share(package) if package else None
        match = _VERSION.search(_manifest(share)) if share is not None else None
        return match[1].decode(errors="replace").strip() if match is not None else ""

    def executable(self, package: str, name: str) -> Path | None:
        """The file of an executable; None if the package has none of that name."""
        inside = f"lib/{package}/{name}"
        prefix = self.first_with(inside)
        return Path(prefix, inside) if prefix else None

    def component_library(self, package: str, plugin: str) -> Path | None:
        """The library that the index names for a component; None if it names none."""
        prefix = self.first_with(f"{_INDEX}/rclcpp_components/{package}")
        index = Path(prefix, _INDEX, "rclcpp_components", package)
        try:
            text = read_bytes(index, max_bytes=_MAX_MANIFEST_BYTES) if prefix else b""
        except (OSError, ValueError):
            text = b""
        for line in text.decode(errors="replace").splitlines():
            name, _, library = line.partition(";")
            if name.strip() == plugin and library.strip():
                return Path(prefix, library.strip())
        return None


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
            if not _MARKERS.isdisjoint(names):
                continue
            if MANIFEST in names:
                manifest = _listed_manifest(folder) if names[MANIFEST] else _manifest(Path(folder))
                if match := _NAME.search(manifest):
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


def _entries(folder: str) -> tuple[dict[str, bool], list[str]]:
    """What may count of a folder.

    Returns:
        The names of its files, and whether each is a regular one; and the folders below it that
        may have packages.
    """
    names, below = dict[str, bool](), list[str]()
    try:
        with os.scandir(folder) as entries:
            for entry in entries:
                if not entry.is_dir(follow_symlinks=False):
                    names[entry.name] = entry.is_file(follow_symlinks=False)
                elif not entry.name.startswith(".") and entry.name not in _NO_SOURCES:
                    below.append(entry.path)
    except OSError:
        pass
    return names, sorted(below, reverse=True)


def _listed_manifest(folder: str) -> bytes:
    try:
        return read_listed(f"{folder}/{MANIFEST}", max_bytes=_MAX_MANIFEST_BYTES)
    except OSError:
        return b""


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
