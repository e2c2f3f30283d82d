"""The programs of a plan on this machine: where they are, and whether the harness can join them.

The harness can join a program into which the linker loads one more object.
"""

from __future__ import annotations

import contextlib
import os
import re
import shutil
import stat
import struct
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Final

from r2bspec import harness
from r2bspec.execute.errors import NotInstalledError, NotJoinableError
from r2bspec.execute.host.machine import interpreter
from r2bspec.native.build import BuildError
from r2bspec.native.harness_objects import harness_library, harness_program
from r2bspec.plan.plan import ProcessPlan

_EXECUTABLE = re.compile(r"\$\(executable (?P<package>\S+) (?P<name>\S+)\)")

_ELF: Final = b"\x7fELF"
_64_BIT_LITTLE_ENDIAN: Final = b"\x02\x01"
_INTERPRETER_SEGMENT: Final = 3
"""PT_INTERP: the dynamic linker of a program; a static one has none."""

_HEADER_BYTES: Final = 64
_SEGMENT_BYTES: Final = 56
_READ_BYTES: Final = 1 << 16
_MAX_SCRIPTS: Final = 4


def resolve_argv(plan: ProcessPlan) -> list[str]:
    """The command line of a process, with the interpreter and full paths of executables.

    Raises:
        NotInstalledError: a package, executable or program is not on this machine.
    """
    argv = resolve_command(plan.argv, f"process {plan.name}")
    if hosts_library(plan):
        native_library()
    return argv


def hosts_library(plan: ProcessPlan) -> bool:
    """Whether player and monitor run in a process of Python nodes."""
    return plan.role == "harness" and bool(plan.nodes)


def native_library() -> Path:
    """The library of players and monitors.

    Raises:
        NotInstalledError: it cannot be built on this machine.
    """
    with build_errors():
        return harness_library()


@contextlib.contextmanager
def build_errors() -> Iterator[None]:
    """What cannot be built is not installed, to a run."""
    try:
        yield
    except BuildError as error:
        raise NotInstalledError(str(error), hint=error.hint, code=error.code) from error


def resolve_command(words: Sequence[str], what: str) -> list[str]:
    """Resolve any command; `what` names its owner in the error.

    Raises:
        NotInstalledError: a package, executable or program is not on this machine.
    """
    argv = [_resolve(word) for word in words]
    if "/" not in argv[0]:
        found = shutil.which(argv[0])
        if found is None:
            raise NotInstalledError(
                f"{what}: program {argv[0]!r} is not on PATH",
                hint="Install it, or correct the command in the spec.",
                code="R2B621",
            )
        argv[0] = found
    return argv


def _resolve(word: str) -> str:
    if word == "$(python)":
        return interpreter()
    if word == "$(harness)":
        with build_errors():
            return str(harness_program())
    if word == "$(included_launch)":
        return str(Path(harness.__file__).with_name("included_launch.py"))
    found = _EXECUTABLE.fullmatch(word)
    return str(find_executable(found["package"], found["name"])) if found else word


def find_executable(package: str, name: str) -> Path:
    """The executable of an ament package: ``PREFIX/lib/PACKAGE/NAME``.

    The index is read directly (a package is a file with its name in
    ``share/ament_index/resource_index/packages``), so this works without ament's Python package.

    Raises:
        NotInstalledError: no prefix in AMENT_PREFIX_PATH has the package or the executable.
    """
    prefixes = [Path(each) for each in os.environ.get("AMENT_PREFIX_PATH", "").split(":") if each]
    index = "share/ament_index/resource_index/packages"
    having = [prefix for prefix in prefixes if (prefix / index / package).exists()]
    if not having:
        raise NotInstalledError(
            f"ROS package {package!r} is not installed in {len(prefixes)} ament prefixes",
            hint="Install it, or source the workspace that contains it.",
            code="R2B622",
        )
    for prefix in having:
        candidate = prefix / "lib" / package / name
        if _executable(candidate):
            return candidate
    available = sorted(
        each.name for each in (having[0] / "lib" / package).glob("*") if _executable(each)
    )
    raise NotInstalledError(
        f"ROS package {package!r} has no executable {name!r}",
        hint=f"Its executables: {', '.join(available) or 'none'}.",
        code="R2B623",
    )


def _executable(path: Path) -> bool:
    return path.is_file() and os.access(path, os.X_OK)


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
