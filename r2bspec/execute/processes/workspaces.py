"""Workspaces: the environment of a setup file or a prefix, and running in it."""

from __future__ import annotations

import contextlib
import importlib
import os
import shutil
import subprocess
import sys
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path

from r2bspec.execute.errors import WorkspaceError

_SETUP_FILES = ("setup.bash", "local_setup.bash", "setup.sh", "local_setup.sh")
_SOURCE_TIMEOUT_S = 60.0

_SHELL_VARIABLES = {"_", "SHLVL", "PWD", "OLDPWD", "BASH_ENV", "ENV", "PS1", "COLUMNS", "LINES"}
"""Variables that a shell itself changes; they are not part of a workspace."""


@contextlib.contextmanager
def applied_environment(changes: Mapping[str, str]) -> Iterator[None]:
    """Change the environment of this process while the context lasts.

    Programs and packages are looked up, and processes started, in this environment.

    Args:
        changes: variables by name; an empty value removes one.
    """
    before = {name: os.environ.get(name) for name in changes}
    _apply_changes(changes)
    try:
        yield
    finally:
        _apply_changes({name: value or "" for name, value in before.items()})


def _apply_changes(changes: Mapping[str, str]) -> None:
    if "PYTHONPATH" in changes:
        # What is looked up here is found where the processes of a run will find it.
        before = _folders(os.environ.get("PYTHONPATH", ""))
        kept = [folder for folder in sys.path if folder not in before]
        sys.path[:] = [*_folders(changes["PYTHONPATH"]), *kept]
        importlib.invalidate_caches()
    for name, value in changes.items():
        if value:
            os.environ[name] = value
        else:
            os.environ.pop(name, None)


def _folders(value: str) -> list[str]:
    """The folders of PYTHONPATH as they are in ``sys.path``."""
    if sys.flags.ignore_environment:
        return []
    return [os.path.abspath(folder) for folder in value.split(os.pathsep) if folder]  # noqa: PTH100


def workspace_environments(texts: Iterable[str]) -> dict[str, str]:
    """The combined changes of several environments, each applied after those before it.

    Raises:
        WorkspaceError: one of them does not exist, or cannot be sourced.
    """
    found: dict[str, str] = {}
    for text in texts:
        with applied_environment(found):
            found |= workspace_environment(text)
    return found


def workspace_environment(text: str) -> dict[str, str]:
    """The changes of an environment.

    Args:
        text: a setup file (``install/setup.bash``), a prefix with a setup file or with programs
            and packages in ``bin``, ``lib`` and ``share``, or ``NAME=VALUE``.

    Returns:
        The variables that differ from those of this process; empty for one that is removed.

    Raises:
        WorkspaceError: the file or folder does not exist, or cannot be sourced.
    """
    path = Path(text).expanduser()
    if path.is_file():
        return _source_setup_file(path)
    if path.is_dir():
        found = next((path / each for each in _SETUP_FILES if (path / each).is_file()), None)
        return _source_setup_file(found) if found is not None else _prefix_environment(path)
    name, equals, value = text.partition("=")
    if equals and name.isidentifier():
        return {name: value} if os.environ.get(name, "") != value else {}
    raise WorkspaceError(
        f"environment {text!r} does not exist",
        hint="Give a setup file, the folder of an installed workspace, or NAME=VALUE.",
    )


def _source_setup_file(path: Path) -> dict[str, str]:
    """The changes of sourcing a file, which the user trusts as in a terminal."""
    shell = shutil.which("sh" if path.suffix == ".sh" else "bash")
    if shell is None:
        raise WorkspaceError(f"{path} needs bash, which is not on PATH")
    script = '. "$0" >&2 && exec env -0'
    try:
        done = subprocess.run(
            [shell, "-c", script, str(path.absolute())],
            capture_output=True,
            timeout=_SOURCE_TIMEOUT_S,
            check=False,
            stdin=subprocess.DEVNULL,
        )
    except subprocess.TimeoutExpired as error:
        raise WorkspaceError(
            f"sourcing {path} did not finish within {_SOURCE_TIMEOUT_S:g} s"
        ) from error
    if done.returncode:
        lines = done.stderr.decode(errors="replace").strip().splitlines()
        raise WorkspaceError(
            f"{path} cannot be sourced: {lines[-1] if lines else f'status {done.returncode}'}"
        )
    text = done.stdout.decode(errors="surrogateescape")
    after = dict(each.split("=", 1) for each in text.split("\0") if "=" in each)
    return _changed_variables(after)


def _changed_variables(after: Mapping[str, str]) -> dict[str, str]:
    before = os.environ
    found = {name: value for name, value in after.items() if before.get(name) != value}
    found |= {name: "" for name in before if name not in after}
    return {
        name: value
        for name, value in sorted(found.items())
        if name not in _SHELL_VARIABLES and not name.startswith("BASH_FUNC_")
    }


def _prefix_environment(path: Path) -> dict[str, str]:
    """The variables that an overlay of this prefix prepends."""
    path = path.absolute()
    python = f"python{sys.version_info.major}.{sys.version_info.minor}"
    front = {
        "AMENT_PREFIX_PATH": [path] if (path / "share" / "ament_index").is_dir() else [],
        "PATH": [path / "bin"],
        "LD_LIBRARY_PATH": [path / "lib"],
        "PYTHONPATH": [
            path / "lib" / python / "site-packages",
            path / "local" / "lib" / python / "dist-packages",
        ],
    }
    found = {
        name: os.pathsep.join(
            [*map(str, existing), *([os.environ[name]] if os.environ.get(name) else [])]
        )
        for name, folders in front.items()
        if (existing := [each for each in folders if each.is_dir()])
    }
    if not found:
        raise WorkspaceError(
            f"{path} is not a workspace: it has neither a setup file nor programs or packages",
            hint="Give the 'install' folder of a workspace, or its setup.bash.",
        )
    return found
