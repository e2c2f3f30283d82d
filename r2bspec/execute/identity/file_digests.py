"""Digests of files, and the build ids of executables and libraries.

A build id is a note that the linker writes into an ELF file (``.note.gnu.build-id``): it stands for
the content, and reading it takes a few hundred bytes of a file of many megabytes.
"""

from __future__ import annotations

import hashlib
import os
import struct
from pathlib import Path
from typing import BinaryIO, Final

from r2bspec.record.graph_identity import FileDigest
from r2bspec.safe_io.safe_file import open_regular

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
