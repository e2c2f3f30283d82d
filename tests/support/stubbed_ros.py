"""Programs that call functions with the names of rcl's and libtracetools', built for the tests."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Sequence
from functools import cache
from pathlib import Path
from typing import Literal

import pytest

from r2bspec.native.build import (
    BuildError,
    Kind,
    RosFiles,
    anatomy_environment,
    anatomy_object,
    build,
    find_compiler,
)

_FOLDER = Path(__file__).parent
_NO_ROS = RosFiles(prefixes=(), wheels=False)

Linked = Literal["linked", "loaded"]
"""A program is linked to rcl, or loads it for itself alone, as rclpy does."""

_LOADING = "import ctypes, sys; ctypes.CDLL(sys.argv[1]).call_ros(sys.argv[2].encode(), 0, 0)"


def _build(name: str, source: str, kind: Kind, flags: Sequence[str], *libraries: str) -> Path:
    try:
        return build(
            name,
            [_FOLDER / source],
            _NO_ROS,
            kind=kind,
            compiler=find_compiler(),
            flags=flags,
            libraries=("-pthread", "-ldl", *libraries),
        )
    except BuildError as error:
        if "compiler" in str(error) or "san" in str(error):
            pytest.skip(str(error))
        raise


@cache
def _libraries(flags: tuple[str, ...]) -> tuple[str, ...]:
    """Flags that link to both stubs."""
    words: list[str] = []
    for name, define in (("libtracetools.so", "-DSTUB_TRACETOOLS"), ("librcl.so", "-DSTUB_RCL")):
        path = _build(
            name, "stub_ros.c", "library", (define, f"-Wl,-soname,{name}", *flags), *words
        )
        words = [str(path), f"-Wl,--disable-new-dtags,-rpath,{path.parent}", *words]
    return tuple(words)


def call_ros(
    folder: Path,
    *words: str,
    how: Linked = "linked",
    max_bytes: int = 2 << 20,
    flags: tuple[str, ...] = (),
    preloaded: str = "",
    environment: dict[str, str] | None = None,
    observed: bool = True,
) -> subprocess.CompletedProcess[str]:
    """Run ``call_ros.c`` with the object that records events.

    Args:
        folder: for the rows.
        words: what it calls.
        how: it comes to its libraries.
        max_bytes: of a file.
        flags: for the compiler, of everything.
        preloaded: behind the object.
        environment: beside what the object needs.
        observed: whether the object is preloaded.
    """
    linked = _libraries(flags)
    anatomy = anatomy_object(flags)
    if how == "linked":
        command = [str(_build("call_ros", "call_ros.c", "program", flags, *linked)), *words]
    else:
        library = _build("libcall_ros.so", "call_ros.c", "library", flags, *linked)
        command = [sys.executable, "-c", _LOADING, str(library), *words]
    variables = anatomy_environment(anatomy, folder, "name/of process", max_bytes, preloaded)
    return subprocess.run(
        command,
        env=os.environ | (variables if observed else {}) | (environment or {}),
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
