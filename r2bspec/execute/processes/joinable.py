"""Which programs the harness can join: those into which the linker loads one more object."""

from __future__ import annotations

import os
import shutil
import stat
import struct
from collections.abc import Sequence
from pathlib import Path
from typing import Final

from r2bspec.execute.errors import NotJoinableError

_ELF: Final = b"\x7fELF"
_64_BIT_LITTLE_ENDIAN: Final = b"\x02\x01"
_INTERPRETER_SEGMENT: Final = 3
"""PT_INTERP: the dynamic linker of a program; a static one has none."""

_HEADER_BYTES: Final = 64
_SEGMENT_BYTES: Final = 56
_READ_BYTES: Final = 1 << 16
_MAX_SCRIPTS: Final = 4


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
    others = [found for word in argv[1:] if (found := shutil.which(word)) is not None]
    if "user" not in reason and any(not why_not_joinable(Path(each)) for each in others):
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
                head = file.read(_READ_BYTES)
            if not head.startswith(b"#!"):
                return _of_elf(head) or _of_privileges(program)
            words = head[2:].split(b"\n", 1)[0].split()
            program = Path(os.fsdecode(words[0])) if words else Path("/bin/sh")
    except OSError:
        return ""
    return ""


def _of_elf(head: bytes) -> str:
    if not head.startswith(_ELF) or len(head) < _HEADER_BYTES:
        return ""
    if head[4:6] != _64_BIT_LITTLE_ENDIAN or head[18:20] != _own_machine():
        return "is built for another kind of processor"
    begin, size, count = _segments(head)
    for number in range(count):
        at = begin + number * size
        if at + _SEGMENT_BYTES > len(head):
            return ""
        kind, offset, length = _segment(head, at)
        if kind == _INTERPRETER_SEGMENT:
            linker = head[offset : offset + length].rstrip(b"\0")
            musl = b"ld-musl" in linker
            return "uses another C library than ROS (musl)" if musl else ""
    return "is linked statically"


def _own_machine() -> bytes:
    with open("/proc/self/exe", "rb") as file:  # noqa: PTH123 - the running program, not a path
        return file.read(20)[18:20]


def _segments(head: bytes) -> tuple[int, int, int]:
    """Where the program headers begin, their size, and how many there are."""
    (begin,) = struct.unpack_from("<Q", head, 32)
    size, count = struct.unpack_from("<HH", head, 54)
    return begin, size, count


def _segment(head: bytes, at: int) -> tuple[int, int, int]:
    """The type of a segment, and its place and size in the file."""
    (kind,) = struct.unpack_from("<I", head, at)
    (offset,) = struct.unpack_from("<Q", head, at + 8)
    (length,) = struct.unpack_from("<Q", head, at + 32)
    return kind, offset, length


def _of_privileges(program: Path) -> str:
    """The linker ignores what is preloaded if a program runs as another user than its caller."""
    found = program.stat()
    other_user = found.st_mode & stat.S_ISUID and found.st_uid != os.getuid()
    other_group = found.st_mode & stat.S_ISGID and found.st_gid != os.getgid()
    if other_user or other_group:
        return "runs as another user (setuid or setgid)"
    try:
        capable = bool(os.getxattr(program, "security.capability"))
    except OSError:
        capable = False
    return "runs with privileges that its user does not have" if capable and os.getuid() else ""
