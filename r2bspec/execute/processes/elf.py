"""What the file of a program says of it, in its ELF header above all.

The harness joins a process through an object that is preloaded into it. Only the dynamic linker of
this machine loads such an object, and it does not for a program that runs as another user than its
caller.
"""

from __future__ import annotations

import os
import shutil
import stat
import struct
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO, Final

from r2bspec.execute.errors import NotJoinableError

ELF: Final = b"\x7fELF"
_LAYOUTS: Final = {
    # By class: the header after the identification, an entry of the program header, and where an
    # entry has the offset and the size of its segment.
    1: ("HHIIIIIHHHHHH", "IIIIIIII", (1, 4)),
    2: ("HHIQQQIHHHHHH", "IIQQQQQQ", (2, 5)),
}
_MAX_SEGMENTS: Final = 512
_MAX_SEGMENT_BYTES: Final = 65_536
_INTERPRETER_SEGMENT: Final = 3
"""PT_INTERP: the dynamic linker of a program; a static one has none."""

_MAX_SCRIPTS: Final = 4

DAMAGED: Final = (struct.error, ValueError, OverflowError)
"""What reading a damaged file raises: it ends too early, or an offset is none."""


@dataclass(frozen=True)
class ElfFile:
    """An ELF file that is open.

    Attributes:
        file: its content.
        order: of its bytes, as `struct` names it.
        machine: what it was built for: class, order of bytes, and processor.
        entries: the type, the offset and the size of each segment.
    """

    file: BinaryIO
    order: str
    machine: tuple[int, int, int]
    entries: tuple[tuple[int, int, int], ...]

    def segments(self, kind: int) -> Iterator[bytes]:
        """The contents of the segments of a type, each up to a limit.

        Raises:
            DAMAGED: the file is damaged.
        """
        for segment, offset, size in self.entries:
            if segment == kind:
                self.file.seek(offset)
                yield self.file.read(min(size, _MAX_SEGMENT_BYTES))


def read_elf(file: BinaryIO) -> ElfFile | None:
    """The header of a file; None if it is not an ELF file.

    Raises:
        DAMAGED: the file is damaged.
    """
    identification = file.read(16)
    layout = _LAYOUTS.get(identification[4]) if len(identification) == 16 else None
    if layout is None or not identification.startswith(ELF):
        return None
    order = "<" if identification[5] == 1 else ">"
    header, entry = struct.Struct(order + layout[0]), struct.Struct(order + layout[1])
    fields = header.unpack(file.read(header.size))
    processor, table, entry_bytes, count = fields[1], fields[4], fields[8], fields[9]
    file.seek(table)
    rows = file.read(entry_bytes * min(count, _MAX_SEGMENTS))
    offset_at, size_at = layout[2]
    entries = []
    for start in range(0, len(rows), max(entry_bytes, 1)):
        row = entry.unpack(rows[start : start + entry.size])
        entries.append((row[0], row[offset_at], row[size_at]))
    machine = (identification[4], identification[5], processor)
    return ElfFile(file, order, machine, tuple(entries))


def require_joinable(name: str, argv: Sequence[str]) -> None:
    """See that the harness can join a process, as far as its program shows.

    A wrapper, such as ``taskset``, may be what cannot be joined, and start a program that can.

    Args:
        name: of the process, for the error.
        argv: its resolved command line.

    Raises:
        NotJoinableError: it cannot.
    """
    reason = why_not_joinable(Path(argv[0]))
    if not reason:
        return
    others = [program_path for word in argv[1:] if (program_path := shutil.which(word)) is not None]
    if "user" not in reason and any(not why_not_joinable(Path(other)) for other in others):
        return
    raise not_joinable(name, f"{argv[0]} {reason}")


def not_joinable(name: str, reason: str) -> NotJoinableError:
    """The error for a process that the harness cannot join, with the ways out."""
    return NotJoinableError(
        f"player and monitors cannot join process {name}: {reason}",
        hint="Write 'harness: {placement: separate}', or name another process with 'in'.",
    )


def why_not_joinable(program: Path) -> str:
    """Why a program ignores preloaded objects; empty if it does not, or that is unknown."""
    try:
        for _ in range(_MAX_SCRIPTS):
            with program.open("rb") as file:
                if file.read(2) != b"#!":
                    file.seek(0)
                    return _why_not_linked(file) or _why_not_permitted(program)
                words = file.readline(_MAX_SEGMENT_BYTES).split()
            program = Path(os.fsdecode(words[0])) if words else Path("/bin/sh")
    except (OSError, *DAMAGED):
        pass
    return ""


def _why_not_linked(file: BinaryIO) -> str:
    elf = read_elf(file)
    if elf is None:
        return ""
    with Path("/proc/self/exe").open("rb") as running:
        own = read_elf(running)
    if own is not None and elf.machine != own.machine:
        return "is built for another kind of processor"
    linkers = [*elf.segments(_INTERPRETER_SEGMENT)]
    if not linkers:
        return "is linked statically"
    return "uses another C library than ROS (musl)" if b"ld-musl" in linkers[0] else ""


def _why_not_permitted(program: Path) -> str:
    """The linker ignores what is preloaded if a program runs as another user than its caller."""
    status = program.stat()
    other_user = status.st_mode & stat.S_ISUID and status.st_uid != os.getuid()
    other_group = status.st_mode & stat.S_ISGID and status.st_gid != os.getgid()
    if other_user or other_group:
        return "runs as another user (setuid or setgid)"
    try:
        capable = bool(os.getxattr(program, "security.capability"))
    except OSError:
        capable = False
    return "runs with privileges that its user does not have" if capable and os.getuid() else ""
