"""The program and the library of the harness, built for the ROS in use."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from pathlib import Path

from r2bspec.native.build import Kind, build, find_compiler
from r2bspec.native.ros_headers import find_ros

PROGRAM = "r2bspec_harness"
LIBRARY = "libr2bspec_harness.so"

_FOLDER = Path(__file__).parent
_SOURCES = ("control.c", "monitor.c", "player.c", "ros.c")
_FLAGS = ("-fwrapv",)


def harness_program(
    environ: Mapping[str, str] = os.environ, flags: Sequence[str] = (), cache: Path | None = None
) -> Path:
    """The program of a player or a monitor, in a process of its own.

    Raises:
        BuildError: it cannot be built (R2B668).
    """
    return _build(PROGRAM, "program", ("main.c",), environ, flags, cache)


def harness_library(
    environ: Mapping[str, str] = os.environ, flags: Sequence[str] = (), cache: Path | None = None
) -> Path:
    """The library with players and monitors for other processes (`r2bspec_harness_serve`).

    Raises:
        BuildError: it cannot be built (R2B668).
    """
    return _build(LIBRARY, "library", (), environ, flags, cache)


def _build(
    name: str,
    kind: Kind,
    more: Sequence[str],
    environ: Mapping[str, str],
    flags: Sequence[str],
    cache: Path | None,
) -> Path:
    return build(
        name,
        [_FOLDER / each for each in (*_SOURCES, *more)],
        find_ros(environ),
        kind=kind,
        compiler=find_compiler(environ),
        flags=(*_FLAGS, *flags),
        cache=cache,
    )
