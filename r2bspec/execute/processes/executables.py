"""Resolving the command lines of a plan on this machine."""

from __future__ import annotations

import contextlib
import os
import re
import shutil
from collections.abc import Iterator, Sequence
from pathlib import Path

from r2bspec import harness
from r2bspec.execute.errors import NotInstalledError
from r2bspec.execute.host.machine import interpreter
from r2bspec.native.errors import BuildError
from r2bspec.native.harness_library import harness_library, harness_program
from r2bspec.plan.plan import ProcessPlan

_EXECUTABLE = re.compile(r"\$\(executable (?P<package>\S+) (?P<name>\S+)\)")


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
    with _build_errors():
        return harness_library()


@contextlib.contextmanager
def _build_errors() -> Iterator[None]:
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
        with _build_errors():
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
