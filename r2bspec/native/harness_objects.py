"""What is built of the harness: the program, the library, and the object that is preloaded."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from r2bspec.native.build import BuildError, Kind, build, find_compiler, find_ros

PROGRAM = "r2bspec_harness"
LIBRARY = "libr2bspec_harness.so"

_FOLDER = Path(__file__).parent
_SOURCES = ("control.c", "monitor.c", "player.c", "ros.c")
_FLAGS = ("-fwrapv",)


def harness_program(environ: Mapping[str, str] = os.environ, flags: Sequence[str] = ()) -> Path:
    """The program of a player or a monitor, in a process of its own.

    Raises:
        BuildError: it cannot be built (R2B668).
    """
    return _build(PROGRAM, "program", (*_SOURCES, "main.c"), environ, (*_FLAGS, *flags))


def harness_library(flags: Sequence[str] = ()) -> Path:
    """The library with players and monitors for other processes (`r2bspec_harness_serve`).

    Raises:
        BuildError: it cannot be built (R2B668).
    """
    return _build(LIBRARY, "library", _SOURCES, os.environ, (*_FLAGS, *flags))


def _build(
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
    path = _build("r2bspec_join.so", "library", ("join.c",), os.environ, flags, libraries=("-ldl",))
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
