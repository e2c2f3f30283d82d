"""Another workspace: the environment that a setup file or a prefix makes, and running inside it."""

from __future__ import annotations

import contextlib
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
"""What a shell changes by itself, which no workspace means."""


@contextlib.contextmanager
def applied_environment(changes: Mapping[str, str]) -> Iterator[None]:
    """Be in another environment, as if the program had been started there.

    Programs are looked for, packages found and processes started by the environment of this
    process, which is therefore changed for as long as the context lasts.

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
    for name, value in changes.items():
        if value:
            os.environ[name] = value
        else:
            os.environ.pop(name, None)


def workspace_environments(texts: Iterable[str]) -> dict[str, str]:
    """What several environments change together, each on top of those before it.

    Raises:
        WorkspaceError: one of them is not there, or cannot be sourced.
    """
    found: dict[str, str] = {}
    for text in texts:
        with applied_environment(found):
            found |= workspace_environment(text)
    return found


def workspace_environment(text: str) -> dict[str, str]:
    """What an environment changes, by the way a user names it.

    Args:
        text: a setup file (``install/setup.bash``), a prefix that holds one or that has programs
            and packages in ``bin``, ``lib`` and ``share``, or ``NAME=VALUE``.

    Returns:
        The variables that differ from those of this process; empty for one that is removed.

    Raises:
        WorkspaceError: there is no such file or folder, or it cannot be sourced.
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
        f"there is no environment {text!r}",
        hint="Name a setup file, the folder of an installed workspace, or NAME=VALUE.",
    )


def _source_setup_file(path: Path) -> dict[str, str]:
    """What sourcing a file changes. The file is the user's own, as in a terminal."""
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
            f"{path} did not end within {_SOURCE_TIMEOUT_S:g} s when it was sourced"
        ) from error
    if done.returncode:
        said = done.stderr.decode(errors="replace").strip().splitlines()
        raise WorkspaceError(
            f"{path} cannot be sourced: {said[-1] if said else f'status {done.returncode}'}"
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
    """What an overlay of this prefix puts in front."""
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
            [*map(str, there), *([os.environ[name]] if os.environ.get(name) else [])]
        )
        for name, folders in front.items()
        if (there := [each for each in folders if each.is_dir()])
    }
    if not found:
        raise WorkspaceError(
            f"{path} is no workspace: it has neither a setup file nor programs or packages",
            hint="Name the 'install' folder of a workspace, or its setup.bash.",
        )
    return found
