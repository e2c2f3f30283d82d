"""Compiling C on first use, with a cache: the harness above all.

A result is kept under the digest of all its inputs: sources, compiler, headers and flags. It is
compiled in a folder of its own and moved into place, so that two builds at once do not disturb each
other, and an interrupted build leaves nothing behind that would be used.

What is kept is run, so it is kept where no other user can write (`safe_io.cache_folder`). Where
there is no such cache, a result ends with this process.

A ROS installation that is sourced has headers and libraries in its prefixes
(``AMENT_PREFIX_PATH``); the wheels have them in the environment of the interpreter. Both have one
folder for each package below ``include``.
"""

from __future__ import annotations

import contextlib
import hashlib
import os
import shlex
import shutil
import subprocess
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from r2bspec.errors import ExitStatus, R2bspecError
from r2bspec.extras import install_command
from r2bspec.safe_io.cache_folder import cache_or_temporary_folder
from r2bspec.safe_io.private_files import private_files, process_folder, temporary_folder

NOT_BUILT = "R2B668"


class BuildError(R2bspecError):
    """The native part of the harness cannot be built on this machine."""

    code = NOT_BUILT
    exit_code = ExitStatus.USAGE
    way_out = "'r2bspec doctor' says what the compiler lacks."


RCL_PACKAGES = (
    *("rcl", "rmw", "rcutils", "rosidl_runtime_c", "rosidl_typesupport_interface"),
    *("rosidl_dynamic_typesupport", "rcl_yaml_param_parser", "type_description_interfaces"),
    *("service_msgs", "builtin_interfaces", "rcl_interfaces", "rosidl_typesupport_c"),
)
"""The packages whose headers rcl's own include."""

_MARKER = Path("rcl/rcl/rcl.h")


@dataclass(frozen=True)
class RosFiles:
    """The parts of a ROS installation that a C program needs.

    Attributes:
        prefixes: in the order of their precedence.
        wheels: whether they are the wheels of this interpreter, whose libraries have unresolved
            symbols of CPython.
    """

    prefixes: tuple[Path, ...]
    wheels: bool

    def include_folders(self, packages: Sequence[str] = RCL_PACKAGES) -> list[Path]:
        """Return the folders of headers of some packages, as far as they are installed."""
        return [
            folder
            for prefix in self.prefixes
            for package in packages
            if (folder := prefix / "include" / package).is_dir()
        ]

    def library_folders(self) -> list[Path]:
        """Return the folders in which the linker finds the libraries."""
        return [folder for prefix in self.prefixes if (folder := prefix / "lib").is_dir()]


def find_ros(environ: Mapping[str, str] = os.environ) -> RosFiles:
    """Find the ROS of processes with this environment; a sourced ROS precedes the wheels.

    Raises:
        BuildError: there are no headers of rcl (R2B668).
    """
    sourced = tuple(Path(path) for path in environ.get("AMENT_PREFIX_PATH", "").split(":") if path)
    if any((prefix / "include" / _MARKER).is_file() for prefix in sourced):
        return RosFiles(prefixes=sourced, wheels=False)
    if (Path(sys.prefix) / "include" / _MARKER).is_file():
        return RosFiles(prefixes=(*sourced, Path(sys.prefix)), wheels=True)
    where = ", ".join(str(path) for path in (*sourced, Path(sys.prefix)))
    raise BuildError(
        f"the C headers of ROS 2 are not installed: no include/{_MARKER} in {where}",
        hint=f"Source a ROS 2 installation with ros-<distro>-rcl, or {install_command('ros')}.",
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
    """Return the command of the C compiler: ``$CC``, or ``cc``.

    Raises:
        BuildError: there is none (R2B668).
    """
    try:
        words = shlex.split(environ.get("CC", "")) or ["cc"]
    except ValueError as error:
        raise BuildError(
            f"CC is no command: {environ['CC']}: {error}", hint="Unset CC, or correct it."
        ) from error
    path = shutil.which(words[0], path=environ.get("PATH"))
    if path is None:
        raise BuildError(
            f"there is no C compiler: {words[0]} is not in PATH",
            hint="Install one (Debian and Ubuntu: apt install gcc libc6-dev), or name it in CC.",
        )
    return [path, *words[1:]]


_results: dict[str, Path] = {}
"""By the digests of what they were made from."""


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
) -> Path:
    """Compile a program or a library, unless it is in the cache.

    Args:
        name: of the file.
        sources: the C files; headers in their folders belong to them.
        ros: its headers and libraries.
        kind: of the result. A program on the wheels gets stubs of CPython's symbols.
        compiler: from `find_compiler`, which is the default.
        packages: with headers, besides those that rcl needs.
        flags: further ones.
        libraries: to link.

    Returns:
        The path of the result.

    Raises:
        BuildError: there is no compiler, or it rejects the sources.
    """
    command = [*(compiler or find_compiler())]
    includes = ros.include_folders([*RCL_PACKAGES, *packages])
    words = [*_FLAGS, *_KIND_FLAGS[kind], *flags]
    if kind == "program" and ros.wheels and "-lrcl" in libraries:
        # At an address that cannot be used.
        words += [f"-Wl,--defsym={symbol}=0" for symbol in _SYMBOLS.split()]
    words += [f"-isystem{include}" for include in includes]
    links = [f"-L{library_folder}" for library_folder in ros.library_folders()] + [*libraries]
    digest = _digest(command, sources, includes, [name, kind, *words, *links])
    result = _results.get(digest)
    if result is None or not result.is_file():
        command += [*words, *map(str, sources), *links]
        result = _results[digest] = _find_or_make(digest, name, command)
    return result


def _find_or_make(digest: str, name: str, command: Sequence[str]) -> Path:
    folder = cache_or_temporary_folder("native")
    entry = folder / digest
    if (entry / name).is_file():
        return entry / name
    try:
        with private_files(), temporary_folder("build", folder) as scratch:
            made = scratch / "made"
            made.mkdir()
            _compile(made / name, command)
            # Another build may have been faster: its folder is not empty, and its result is used.
            with contextlib.suppress(OSError):
                made.rename(entry)
            if not (entry / name).is_file():
                # The cache has a damaged entry, which is moved away.
                entry.rename(scratch / "damaged")
                made.rename(entry)
    except OSError as error:
        raise BuildError(
            f"cannot build in {folder}: {error.strerror or error}",
            hint="Make room there, or choose another cache folder in XDG_CACHE_HOME.",
        ) from error
    return entry / name


def _compile(target: Path, command: Sequence[str]) -> None:
    try:
        done = subprocess.run(
            [*command, "-o", str(target)],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            env={**os.environ, "LC_ALL": "C", "TMPDIR": str(target.parent)},
            timeout=_TIMEOUT_S,
            check=False,
        )
    except subprocess.TimeoutExpired as error:
        raise BuildError(
            f"{command[0]} took more than {_TIMEOUT_S:g} s for {target.name}"
        ) from error
    if done.returncode or not target.is_file():
        text = done.stdout.decode(errors="replace").splitlines()[:_SHOWN_LINES]
        raise BuildError(
            f"{command[0]} cannot compile {target.name}; it ended with status {done.returncode}"
            + (":\n" + "\n".join(text) if text else " and printed nothing"),
            hint="Headers of libc may be missing (Debian and Ubuntu: apt install libc6-dev), "
            "or CC is not a C compiler; otherwise please report it, with this text.",
        )


def _digest(
    compiler: Sequence[str], sources: Sequence[Path], includes: Sequence[Path], words: Sequence[str]
) -> str:
    """Return the digest of everything that a result is made from."""
    state = hashlib.sha256()
    files = {*sources, *(header for source in sources for header in source.parent.glob("*.h"))}
    for path in sorted(files):
        content = path.read_bytes()
        state.update(f"{path.name} {len(content)}\n".encode() + content)
    # The compiler and the headers by what changes whenever they are installed anew.
    headers = (header for include in includes for header in sorted(include.rglob("*.h")))
    for file in (Path(compiler[0]), *headers):
        status = file.stat()
        state.update(f"{file} {status.st_size} {status.st_mtime_ns}\n".encode())
    state.update("\0".join([*compiler, *words]).encode())
    return state.hexdigest()[:40]


PROGRAM = "r2bspec_harness"
LIBRARY = "libr2bspec_harness.so"

_FOLDER = Path(__file__).parent
_HARNESS_SOURCES = ("control.c", "monitor.c", "player.c", "ros.c")
_HARNESS_FLAGS = ("-fwrapv",)


def harness_program(environ: Mapping[str, str] = os.environ, flags: Sequence[str] = ()) -> Path:
    """Return the program of a player or a monitor in a process of its own.

    Raises:
        BuildError: it cannot be built (R2B668).
    """
    return _build_own(
        PROGRAM, "program", (*_HARNESS_SOURCES, "main.c"), environ, (*_HARNESS_FLAGS, *flags)
    )


def harness_library(flags: Sequence[str] = ()) -> Path:
    """Return the library with players and monitors for other processes (`r2bspec_harness_serve`).

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
) -> Path:
    files, compiler = [_FOLDER / source for source in sources], find_compiler(environ)
    return build(name, files, find_ros(environ), kind=kind, compiler=compiler, flags=flags)


SOCKET_VARIABLE = "R2BSPEC_JOIN_SOCKET"
"""Has the path of the socket on which a run waits for processes of its graph."""

PROCESS_VARIABLE = "R2BSPEC_JOIN_PROCESS"
"""Has the name of the process in the plan; what it starts inherits it."""

_SEPARATORS = " :"
"""No path with one of them can be preloaded."""


def join_object(flags: Sequence[str] = ()) -> Path:
    """Return the object to preload into a process that gets the harness; see ``join.c``.

    Raises:
        BuildError: it cannot be built (R2B668).
    """
    return _object("r2bspec_join.so", ("join.c",), flags)


def join_environment(join: Path, socket: Path, process: str, preloaded: str) -> dict[str, str]:
    """Return the variables with which a process asks the controller for parts of the harness.

    Args:
        join: from `join_object`.
        socket: on which the controller listens.
        process: its name in the plan.
        preloaded: what is preloaded into it already, as in ``LD_PRELOAD``.
    """
    return {
        "LD_PRELOAD": _preload(join, preloaded),
        SOCKET_VARIABLE: str(socket),
        PROCESS_VARIABLE: process,
    }


def anatomy_object(flags: Sequence[str] = ()) -> Path:
    """Return the object to preload into a process whose events are recorded; see ``anatomy.c``.

    Raises:
        BuildError: it cannot be built (R2B668).
    """
    return _object(
        "r2bspec_anatomy.so",
        ("anatomy.c", "anatomy_tracepoints.c", "anatomy_rows.c"),
        ("-ftls-model=initial-exec", *flags),
    )


def anatomy_environment(
    anatomy: Path, folder: Path, process: str, max_bytes: int, preloaded: str
) -> dict[str, str]:
    """Return the variables with which a process and its children record their events.

    Args:
        anatomy: from `anatomy_object`.
        folder: for the files, one for each process that initialises ROS. In memory (``/dev/shm``),
            because writing to the page of a disk may wait for the disk.
        process: its name in the plan.
        max_bytes: of a file, all of which are taken at once; an event needs 64.
        preloaded: what is preloaded into it already, as in ``LD_PRELOAD``.
    """
    return {
        "LD_PRELOAD": _preload(anatomy, preloaded),
        "R2BSPEC_ANATOMY_FOLDER": str(folder),
        "R2BSPEC_ANATOMY_PROCESS": process,
        "R2BSPEC_ANATOMY_BYTES": str(max_bytes),
    }


def _object(name: str, sources: Sequence[str], flags: Sequence[str]) -> Path:
    """Return an object that needs nothing but libc, by a path that can be preloaded."""
    files, no_ros = [_FOLDER / source for source in sources], RosFiles(prefixes=(), wheels=False)
    libraries = ("-ldl", "-pthread")
    path = build(name, files, no_ros, kind="library", flags=flags, libraries=libraries)
    if any(separator in str(path) for separator in _SEPARATORS):
        copy = process_folder("preloaded") / name
        shutil.copy(path, copy)
        return copy
    return path


def _preload(path: Path, preloaded: str) -> str:
    others = [each for each in preloaded.split(":") if each and each != str(path)]
    return ":".join([str(path), *others])
