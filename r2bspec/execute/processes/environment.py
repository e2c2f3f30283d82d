"""The environment of every process of a run: what is inherited, and what the run adds.

Only variables that running ROS programs need are inherited. Secrets that a CI system keeps in
the environment therefore never reach a node, unless the spec names them under ``environment:``.

No spec can refer to the value of a secret (`r2bspec.language.secrets`). The last output of a failed
process is part of the error, the record and the reports: values of secrets are redacted in it.

A workspace is the environment of a setup file or a prefix; r2bspec can run in it.
"""

from __future__ import annotations

import contextlib
import fnmatch
import importlib
import os
import re
import shutil
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any

from r2bspec.execute.errors import WorkspaceError
from r2bspec.execute.processes.bounded_command import run_bounded
from r2bspec.ipc.protocol import MODULES_FOLDER_VARIABLE, RUN_ID_VARIABLE
from r2bspec.language.secrets import REDACTED, is_secret_variable
from r2bspec.middleware.middleware import (
    DISCOVERY_VARIABLES,
    MessageTransport,
    inherited_variables,
    middleware_of,
)
from r2bspec.plan.plan import Plan

_INHERITED_PATTERNS = (
    *("PATH", "HOME", "USER", "LOGNAME", "SHELL", "LANG", "LC_*", "TZ", "TMPDIR", "TERM"),
    *("PYTHON*", "VIRTUAL_ENV", "CONDA_PREFIX", "LD_LIBRARY_PATH", "LD_PRELOAD", "XDG_*"),
    *("ROS_*", "_ROS_*", "AMENT_*", "COLCON_*", "CMAKE_PREFIX_PATH", "RMW_*", "RCUTILS_*", "RCL_*"),
    "R2B_DATASETS",
    *("CUDA_*", "NVIDIA_*", "HIP_*", "ROCR_*", "HSA_*", "LIBGL_*", "VK_*", "__GLX_*", "__NV_*"),
    *("OMP_*", "KMP_*", "MKL_*", "OPENBLAS_*", "OPENCV_*", "TBB_*", "MALLOC_*", "GLIBC_TUNABLES"),
    *("DISPLAY", "WAYLAND_DISPLAY", "XAUTHORITY", "QT_*", "GZ_*", "COVERAGE_*"),
)

MODULES_FOLDER = "modules"
"""In the scratch folder of a run: what programs of Python nodes have imported, by process."""

_MODULE_NAMES = str(Path(__file__).parents[2] / "harness" / "module_names")
"""Has the `sitecustomize` with which a program in Python names the modules that it has imported."""

_HARNESS_ALLOCATOR = {
    # glibc gives every large buffer back to the kernel and faults it in again for the next
    # message; keeping them saves three quarters of the time of a raw receive of an image.
    "MALLOC_MMAP_MAX_": "0",
    "MALLOC_TRIM_THRESHOLD_": str(1 << 30),
    "MALLOC_TOP_PAD_": str(64 << 20),
    # Buffers in huge pages, where the kernel gives them to those who ask: copying an image touches
    # a thousand small ones.
    "GLIBC_TUNABLES": "glibc.malloc.hugetlb=1",
}

_MIN_SECRET_LENGTH = 8
"""Shorter values, such as 'true', occur everywhere in ordinary text."""


def inherited_environment(environ: Mapping[str, str], named: Iterable[str]) -> dict[str, str]:
    """Return the part of an environment that processes of a run get."""
    names = frozenset(named)
    wildcards = (name for name in names if set(name) & set("*?["))
    patterns = (*_INHERITED_PATTERNS, *inherited_variables(), *wildcards)
    return {
        name: value
        for name, value in environ.items()
        if name in names or any(fnmatch.fnmatchcase(name, pattern) for pattern in patterns)
    }


class RunEnvironment:
    """The environments of the processes of a run.

    Attributes:
        middleware: which one the processes load.
        transport: how their messages travel.
        segment_bytes: the shared memory that each process takes when it starts; 0 where that is
            not for the run to decide.
    """

    def __init__(
        self,
        plan: Plan,
        *,
        run_id: str,
        domain: int,
        scratch: Path,
        largest_message_bytes: int,
        ros_logs: Path | None = None,
    ) -> None:
        self._common = inherited_environment(os.environ, plan.environment)
        if path := self._common.get("PYTHONPATH"):
            # Processes run in the folder of the spec; the user means where they are themselves.
            # An empty entry, which a colon too many makes, would be the current folder to Python:
            # what lies there, a stranger's checkout perhaps, must not shadow modules.
            folders = (str(Path(folder).absolute()) for folder in path.split(os.pathsep) if folder)
            self._common["PYTHONPATH"] = os.pathsep.join(folders)
        self._common |= {
            RUN_ID_VARIABLE: run_id,
            MODULES_FOLDER_VARIABLE: str(scratch / MODULES_FOLDER),
            "ROS_DOMAIN_ID": str(domain),
            "PYTHONUNBUFFERED": "1",
            # Otherwise ROS leaves a file for each process in the user's home.
            "ROS_LOG_DIR": str(ros_logs or scratch / "ros_logs"),
        }
        self.middleware = middleware_of(self._common)
        for name in {*DISCOVERY_VARIABLES} - {*plan.environment}:
            self._common.pop(name, None)
        self.transport = MessageTransport(plan.transport, largest_message_bytes, plan.segment_bytes)
        self._common |= self.middleware.configure(self.transport, scratch)
        self.segment_bytes = self.middleware.segment_bytes(self.transport)

    def for_harness(self, changes: Mapping[str, str] = MappingProxyType({})) -> dict[str, str]:
        """Return the environment of loader, player and monitor, and of nodes beside them."""
        return self._common | _HARNESS_ALLOCATOR | dict(changes)

    def for_node(self, changes: Mapping[str, str]) -> dict[str, str]:
        """Return the environment of a process with nodes: that of the plan, and `_MODULE_NAMES`."""
        variables = self._common | dict(changes)
        folders = (variables.get("PYTHONPATH"), _MODULE_NAMES)
        return variables | {"PYTHONPATH": os.pathsep.join(filter(None, folders))}


def replaced_texts(value: Any, replace: Callable[[str], str]) -> Any:
    """Return a value of dictionaries and lists with every text in it replaced, except keys."""
    if isinstance(value, str):
        return replace(value)
    if isinstance(value, dict):
        return {key: replaced_texts(part, replace) for key, part in value.items()}
    if isinstance(value, list | tuple):
        return [replaced_texts(part, replace) for part in value]
    return value


def texts(value: Any) -> Iterator[str]:
    """Yield all texts in a value of dictionaries and lists, except keys."""
    if isinstance(value, str):
        yield value
    elif isinstance(value, dict):
        for entry in value.values():
            yield from texts(entry)
    elif isinstance(value, list | tuple):
        for entry in value:
            yield from texts(entry)


def make_redactor(environ: Mapping[str, str]) -> Callable[[str], str]:
    """Return a function that hides the values of secret variables in a text."""
    secrets = {
        value
        for name, value in environ.items()
        if len(value) >= _MIN_SECRET_LENGTH and is_secret_variable(name)
    }
    if not secrets:
        return str
    # A secret may contain another one.
    pattern = re.compile("|".join(map(re.escape, sorted(secrets, key=len, reverse=True))))
    return lambda text: pattern.sub(REDACTED, text)


_SETUP_FILES = ("setup.bash", "local_setup.bash", "setup.sh", "local_setup.sh")
_SOURCE_TIMEOUT_S = 60.0

_SHELL_VARIABLES = {"_", "SHLVL", "PWD", "OLDPWD", "BASH_ENV", "ENV", "PS1", "COLUMNS", "LINES"}
"""Variables that a shell itself changes; they are not part of a workspace."""


@contextlib.contextmanager
def applied_environment(changes: Mapping[str, str]) -> Iterator[None]:
    """Change the environment of this process for the block.

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
    """Return the folders of PYTHONPATH as they are in ``sys.path``."""
    if sys.flags.ignore_environment:
        return []
    return [os.path.abspath(folder) for folder in value.split(os.pathsep) if folder]  # noqa: PTH100


def workspace_environments(texts: Iterable[str]) -> dict[str, str]:
    """Return the combined changes of several environments, applied in their order.

    Raises:
        WorkspaceError: one of them does not exist, or cannot be sourced.
    """
    environments: dict[str, str] = {}
    for text in texts:
        with applied_environment(environments):
            environments |= workspace_environment(text)
    return environments


def workspace_environment(text: str) -> dict[str, str]:
    """Return the changes that an environment makes.

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
        setup = next((path / name for name in _SETUP_FILES if (path / name).is_file()), None)
        return _source_setup_file(setup) if setup is not None else _prefix_environment(path)
    name, equals, value = text.partition("=")
    if equals and name.isidentifier():
        return {name: value} if os.environ.get(name, "") != value else {}
    raise WorkspaceError(
        f"environment {text!r} does not exist",
        hint="Give a setup file, the folder of an installed workspace, or NAME=VALUE.",
    )


def _source_setup_file(path: Path) -> dict[str, str]:
    """Return the changes of sourcing a file, which the user trusts as in a terminal."""
    shell = shutil.which("sh" if path.suffix == ".sh" else "bash")
    if shell is None:
        raise WorkspaceError(f"{path} needs bash, which is not on PATH")
    script = '. "$0" >&2 && exec env -0'
    done = run_bounded([shell, "-c", script, str(path.absolute())], timeout_s=_SOURCE_TIMEOUT_S)
    if done.problem:
        said = done.last_lines.rpartition("\n")[2]
        raise WorkspaceError(f"{path} cannot be sourced: {said or f'it {done.problem}'}")
    text = done.printed.decode(errors="surrogateescape")
    after = dict(assignment.split("=", 1) for assignment in text.split("\0") if "=" in assignment)
    changes = {name: value for name, value in after.items() if os.environ.get(name) != value}
    changes |= {name: "" for name in os.environ if name not in after}
    return {
        name: value
        for name, value in sorted(changes.items())
        if name not in _SHELL_VARIABLES and not name.startswith("BASH_FUNC_")
    }


def _prefix_environment(path: Path) -> dict[str, str]:
    """Return the variables that an overlay of this prefix prepends."""
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
    changes = {
        name: os.pathsep.join(filter(None, (*existing, os.environ.get(name))))
        for name, folders in front.items()
        if (existing := [str(folder) for folder in folders if folder.is_dir()])
    }
    if not changes:
        raise WorkspaceError(
            f"{path} is not a workspace: it has neither a setup file nor programs or packages",
            hint="Give the 'install' folder of a workspace, or its setup.bash.",
        )
    return changes
