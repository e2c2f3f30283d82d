"""Compiling C on first use, with a cache: the harness above all.

A result is kept under the digest of everything that it was made from: sources, compiler, headers
and flags. It is compiled in a folder of its own and moved into place, so that two builds at once
do not disturb each other, and an interrupted one leaves nothing behind that would be used.

A ROS installation that is sourced has headers and libraries in its prefixes
(``AMENT_PREFIX_PATH``); the wheels have them in the environment of the interpreter. Both have one
folder for each package below ``include``.
"""

from __future__ import annotations

import hashlib
import os
import shlex
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from r2bspec.errors import ExitStatus, R2bspecError
from r2bspec.private_files import private_files

NOT_BUILT = "R2B668"


class BuildError(R2bspecError):
    """The native part of the harness cannot be built on this machine."""

    code = NOT_BUILT
    exit_code = ExitStatus.USAGE


RCL_PACKAGES = (
    *("rcl", "rmw", "rcutils", "rosidl_runtime_c", "rosidl_typesupport_interface"),
    *("rosidl_dynamic_typesupport", "rcl_yaml_param_parser", "type_description_interfaces"),
    *("service_msgs", "builtin_interfaces", "rcl_interfaces", "rosidl_typesupport_c"),
)
"""The packages whose headers rcl's own include."""

_MARKER = Path("rcl/rcl/rcl.h")


@dataclass(frozen=True)
class RosFiles:
    """What a C program needs of a ROS.

    Attributes:
        prefixes: in the order of their precedence.
        wheels: whether they are the wheels of this interpreter, whose libraries have unresolved
            symbols of CPython.
    """

    prefixes: tuple[Path, ...]
    wheels: bool

    def include_folders(self, packages: Sequence[str] = RCL_PACKAGES) -> list[Path]:
        """The folders of headers of some packages, as far as they are installed."""
        return [
            folder
            for prefix in self.prefixes
            for package in packages
            if (folder := prefix / "include" / package).is_dir()
        ]

    def library_folders(self) -> list[Path]:
        """Where the linker finds the libraries."""
        return [folder for prefix in self.prefixes if (folder := prefix / "lib").is_dir()]


def find_ros(environ: Mapping[str, str] = os.environ) -> RosFiles:
    """Find the ROS that processes with this environment use; a sourced one precedes the wheels.

    Raises:
        BuildError: there are no headers of rcl (R2B668).
    """
    sourced = tuple(Path(each) for each in environ.get("AMENT_PREFIX_PATH", "").split(":") if each)
    if any((prefix / "include" / _MARKER).is_file() for prefix in sourced):
        return RosFiles(prefixes=sourced, wheels=False)
    if (Path(sys.prefix) / "include" / _MARKER).is_file():
        return RosFiles(prefixes=(*sourced, Path(sys.prefix)), wheels=True)
    where = ", ".join(str(each) for each in (*sourced, Path(sys.prefix)))
    raise BuildError(
        f"the C headers of ROS 2 are not installed: no include/{_MARKER} in {where}",
        hint="Source a ROS 2 installation with ros-<distro>-rcl, or pip install 'r2bspec[ros]'.",
    )


# Libraries in the wheels are linked to the converters of messages between C and Python, which a
# program without an interpreter never calls. The loader wants their data to exist at once, and
# their functions where ``LD_BIND_NOW`` is set.
_SYMBOLS = """
PyExc_RuntimeError _Py_TrueStruct PyBool_FromLong PyBuffer_Release PyBuffer_ToContiguous
PyBytes_AsStringAndSize PyBytes_FromStringAndSize PyErr_SetString PyFloat_FromDouble
PyImport_ImportModule PyList_New PyList_SetItem PyLong_AsLong PyLong_AsLongLong
PyLong_AsSize_t PyLong_AsUnsignedLong PyLong_AsUnsignedLongLong PyLong_FromLong
PyLong_FromLongLong PyLong_FromUnsignedLong PyLong_FromUnsignedLongLong
PyObject_CallFunctionObjArgs PyObject_CallObject PyObject_CheckBuffer PyObject_GetAttrString
PyObject_GetBuffer PyObject_SetAttrString PyObject_Size PySequence_Fast PySequence_Size
PyUnicode_AsUTF16String PyUnicode_AsUTF8String PyUnicode_DecodeUTF16 PyUnicode_DecodeUTF8
_Py_Dealloc
"""


Kind = Literal["program", "library"]

_FLAGS = (
    *("-std=c11", "-D_GNU_SOURCE", "-O2", "-g", "-Wall", "-Wextra", "-Werror"),
    # A link to a library of ROS finds the libraries behind it when it is loaded.
    "-Wl,--allow-shlib-undefined",
)
_KIND_FLAGS: dict[Kind, tuple[str, ...]] = {
    # What a program defines for libraries has to be visible to them.
    "program": ("-rdynamic",),
    "library": ("-shared", "-fPIC", "-fvisibility=hidden"),
}
_LIBRARIES = ("-lrcl", "-lrmw", "-lrcutils", "-pthread", "-ldl")
_TIMEOUT_S = 120.0
_SHOWN_LINES = 60


def find_compiler(environ: Mapping[str, str] = os.environ) -> list[str]:
    """The command of the C compiler: ``$CC``, or ``cc``.

    Raises:
        BuildError: there is none (R2B668).
    """
    words = shlex.split(environ.get("CC", "")) or ["cc"]
    path = shutil.which(words[0], path=environ.get("PATH"))
    if path is None:
        raise BuildError(
            f"there is no C compiler: {words[0]} is not in PATH",
            hint="Install one (Debian and Ubuntu: apt install gcc libc6-dev), or name it in CC.",
        )
    return [path, *words[1:]]


def cache_folder() -> Path:
    """Where builds are kept: in the user's cache folder ($XDG_CACHE_HOME)."""
    import platformdirs

    return Path(platformdirs.user_cache_dir("r2bspec")) / "native"


def build(
    name: str,
    sources: Sequence[Path],
    ros: RosFiles,
    *,
    kind: Kind,
    compiler: Sequence[str] | None = None,
    packages: Sequence[str] = (),
    flags: Sequence[str] = (),
    libraries: Sequence[str] = _LIBRARIES,
    cache: Path | None = None,
) -> Path:
    """Compile a program or a library, unless it has been.

    Args:
        name: of the file.
        sources: the C files; headers in their folders belong to them.
        ros: its headers and libraries.
        kind: of the result. A program on the wheels gets stubs of CPython's symbols.
        compiler: from `find_compiler`, which is the default.
        packages: with headers, besides those that rcl needs.
        flags: further ones.
        libraries: to link.
        cache: in place of `cache_folder`.

    Returns:
        The path of the result; its folder has no other file.

    Raises:
        BuildError: there is no compiler, it rejects the sources, or the result cannot be kept.
    """
    command = [*(compiler or find_compiler())]
    includes = ros.include_folders([*RCL_PACKAGES, *packages])
    words = [*_FLAGS, *_KIND_FLAGS[kind], *flags]
    if kind == "program" and ros.wheels and "-lrcl" in libraries:
        # At an address that cannot be used.
        words += [f"-Wl,--defsym={symbol}=0" for symbol in _SYMBOLS.split()]
    words += [f"-isystem{each}" for each in includes]
    links = [f"-L{each}" for each in ros.library_folders()] + [*libraries]
    digest = _digest(command, sources, includes, [name, kind, *words, *links])
    entry = (cache_folder() if cache is None else cache) / digest
    try:
        with private_files():
            entry.parent.mkdir(parents=True, exist_ok=True)
            _refuse_foreign(entry.parent)
            _require_executable(entry.parent)
            if not (entry / name).exists():
                _compile(entry, name, [*command, *words, *map(str, sources), *links])
    except OSError as error:
        raise BuildError(
            f"cannot build in {entry.parent}: {error.strerror or error}",
            hint="Make room there, or choose another cache folder in XDG_CACHE_HOME.",
        ) from error
    return entry / name


def _compile(entry: Path, name: str, command: Sequence[str]) -> None:
    with tempfile.TemporaryDirectory(prefix=".building-", dir=entry.parent) as scratch:
        made = Path(scratch) / "made"
        made.mkdir()
        try:
            done = subprocess.run(
                [*command, "-o", str(made / name)],
                stdin=subprocess.DEVNULL,
                stdout=subprocess.PIPE,
                stderr=subprocess.STDOUT,
                env={**os.environ, "LC_ALL": "C", "TMPDIR": scratch},
                timeout=_TIMEOUT_S,
                check=False,
            )
        except subprocess.TimeoutExpired as error:
            raise BuildError(f"{command[0]} took more than {_TIMEOUT_S:g} s for {name}") from error
        if done.returncode or not (made / name).is_file():
            text = done.stdout.decode(errors="replace").splitlines()[:_SHOWN_LINES]
            raise BuildError(
                f"{command[0]} cannot compile {name}; it ended with status {done.returncode}"
                + (":\n" + "\n".join(text) if text else " and printed nothing"),
                hint="Headers of libc may be missing (Debian and Ubuntu: apt install libc6-dev), "
                "or CC names something that is no C compiler; otherwise please report it, with "
                "this text.",
            )
        try:
            made.rename(entry)
        except OSError:
            # Another build of the same may have been faster.
            if not entry.is_dir():
                raise


def _digest(
    compiler: Sequence[str], sources: Sequence[Path], includes: Sequence[Path], words: Sequence[str]
) -> str:
    """The digest of everything that a result is made from."""
    state = hashlib.sha256()
    files = {*sources, *(each for one in sources for each in one.parent.glob("*.h"))}
    for path in sorted(files):
        content = path.read_bytes()
        state.update(f"{path.name} {len(content)}\n".encode() + content)
    # The compiler and the headers by what changes whenever they are installed anew.
    headers = (each for one in includes for each in sorted(one.rglob("*.h")))
    for each in (Path(compiler[0]), *headers):
        found = each.stat()
        state.update(f"{each} {found.st_size} {found.st_mtime_ns}\n".encode())
    state.update("\0".join([*compiler, *words]).encode())
    return state.hexdigest()[:40]


def _refuse_foreign(folder: Path) -> None:
    """Refuse a cache in which another user could have placed what will be run.

    Raises:
        BuildError: the folder is not this user's, or others may write to it.
    """
    status = folder.stat()
    if status.st_uid != os.geteuid() or status.st_mode & 0o022:
        raise BuildError(
            f"other users can write to {folder}, in which programs are kept",
            hint="Remove it, or choose another cache folder in XDG_CACHE_HOME.",
        )


def _require_executable(folder: Path) -> None:
    """See that what is built in a folder can be run.

    Raises:
        BuildError: its file system is mounted noexec.
    """
    if os.statvfs(folder).f_flag & os.ST_NOEXEC:
        raise BuildError(
            f"no program can run in {folder}: its file system is mounted noexec",
            hint="Choose a cache folder on another file system in XDG_CACHE_HOME.",
        )


PROGRAM = "r2bspec_harness"
LIBRARY = "libr2bspec_harness.so"

_FOLDER = Path(__file__).parent
_HARNESS_SOURCES = ("control.c", "monitor.c", "player.c", "ros.c")
_HARNESS_FLAGS = ("-fwrapv",)


def harness_program(environ: Mapping[str, str] = os.environ, flags: Sequence[str] = ()) -> Path:
    """The program of a player or a monitor, in a process of its own.

    Raises:
        BuildError: it cannot be built (R2B668).
    """
    return _build_own(
        PROGRAM, "program", (*_HARNESS_SOURCES, "main.c"), environ, (*_HARNESS_FLAGS, *flags)
    )


def harness_library(flags: Sequence[str] = ()) -> Path:
    """The library with players and monitors for other processes (`r2bspec_harness_serve`).

    Raises:
        BuildError: it cannot be built (R2B668).
    """
    return _build_own(LIBRARY, "library", _HARNESS_SOURCES, os.environ, (*_HARNESS_FLAGS, *flags))


def _build_own(
    name: str,
    kind: Kind,
    sources: Sequence[str],
    environ: Mapping[str, str],
    flags: Sequence[str],
    **more: Any,
) -> Path:
    files, compiler = [_FOLDER / source for source in sources], find_compiler(environ)
    return build(name, files, find_ros(environ), kind=kind, compiler=compiler, flags=flags, **more)


SOCKET_VARIABLE = "R2BSPEC_JOIN_SOCKET"
"""Has the path of the socket on which a run waits for processes of its graph."""

PROCESS_VARIABLE = "R2BSPEC_JOIN_PROCESS"
"""Has the name of the process in the plan; what it starts inherits it."""

_SEPARATORS = " :"
"""No path with one of them can be preloaded."""


def join_object(flags: Sequence[str] = ()) -> Path:
    """The object to preload; see ``join.c``.

    Raises:
        BuildError: it cannot be built, or its path cannot be preloaded (R2B668).
    """
    path = _build_own(
        "r2bspec_join.so", "library", ("join.c",), os.environ, flags, libraries=("-ldl",)
    )
    if any(each in str(path) for each in _SEPARATORS):
        raise BuildError(
            f"{path} cannot be preloaded: the path has a blank or a colon",
            hint="Choose a cache folder without them in XDG_CACHE_HOME.",
        )
    return path


def join_environment(join: Path, socket: Path, process: str, preloaded: str) -> dict[str, str]:
    """The variables with which a process asks the controller whether it gets the harness.

    Args:
        join: from `join_object`.
        socket: on which the controller listens.
        process: its name in the plan.
        preloaded: what is preloaded into it already, as in ``LD_PRELOAD``.
    """
    return {
        "LD_PRELOAD": f"{join}:{preloaded}" if preloaded else str(join),
        SOCKET_VARIABLE: str(socket),
        PROCESS_VARIABLE: process,
    }
