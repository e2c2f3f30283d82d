"""Executing a script or a launch file in a child process, and its recorded actions as values.

The child has stand-ins for what the file imports of ROS (`recorder`), a process group of its own, a
time limit, and no output but its result. Texts have marks for what is unknown and for what the
machine decides: see `stand_ins`.
"""

from __future__ import annotations

import contextlib
import json
import os
import signal
import subprocess
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final, Literal

import msgspec

from r2bspec.diagnostics import Diagnostic, Severity, Span
from r2bspec.errors import R2bspecError
from r2bspec.report.output import echo
from r2bspec.safe_io.file_search import path_hint
from r2bspec.safe_io.limits import MAX_PYTHON_BYTES
from r2bspec.safe_io.private_files import temporary_folder
from r2bspec.safe_io.safe_file import is_regular

TIME_LIMIT_S: Final = 60.0
_MAX_RESULT_BYTES: Final = 20_000_000
_UNUSABLE: Final = "R2B701"
_NOT_SUCH_A_FILE: Final = "R2B704"

Place = tuple[str, int]
"""A file and a line."""
Kind = Literal["script", "launch"]
NoteKind = Literal["lost", "missing", "changed"]


class Note(msgspec.Struct, frozen=True):
    """Something that the spec lacks (``lost``, or ``missing`` with its module) or changes."""

    kind: NoteKind
    reason: str
    place: Place


class Process(msgspec.Struct):
    """What an action says of its process: environment variables, and words before the command."""

    environment: dict[str, str] = {}
    prefix: list[str] = []


class NodeAction(Process, kw_only=True):
    """A node, a component or a program that a file starts.

    Attributes:
        namespace: absolute; empty for the root.
        parameters: maps and paths of files, in order.
        container: the name of the container that it is loaded into.
        lifecycle: the state into which the file brings it; empty if it makes no transition.
    """

    name: str
    place: Place
    package: str = ""
    plugin: str = ""
    executable: str = ""
    command: list[str] = []
    namespace: str = ""
    parameters: list[Any] = []
    remappings: list[tuple[str, str]] = []
    arguments: list[str] = []
    container: str = ""
    extra_arguments: dict[str, Any] = {}
    lifecycle: str = ""

    @property
    def plugin_class(self) -> str:
        """The last part of the plugin: ``ResizeNode``."""
        return self.plugin.rpartition("::")[2]

    def parameter(self, name: str) -> Any:
        """Return the last value of a parameter in the file; None without one."""
        maps = [each for each in self.parameters if isinstance(each, dict) and name in each]
        return maps[-1][name] if maps else None

    def remapped(self, source: str) -> str:
        """Return what the node calls `source` in the graph; by default itself."""
        targets = (target for old, target in self.remappings if old.lstrip("/") == source)
        return next(targets, source)


class ContainerAction(Process, kw_only=True):
    """A component container; `full_name` has its namespace."""

    name: str
    full_name: str
    executable: str
    place: Place
    arguments: list[str] = []
    parameters: list[Any] = []
    remappings: list[tuple[str, str]] = []


class IncludeAction(msgspec.Struct, kw_only=True):
    """An included launch file."""

    place: Place
    path: str
    arguments: dict[str, str] = {}
    namespace: str = ""
    remappings: list[tuple[str, str]] = []
    environment: dict[str, str] = {}

    @property
    def name(self) -> str:
        """The name of the file."""
        return self.path.rpartition("/")[2]


Member = NodeAction | IncludeAction


class Step(msgspec.Struct, kw_only=True):
    """A step around the launch: a command, a file to wait for, or the call of a service."""

    kind: Literal["setup", "ready", "after_ready"]
    key: str
    place: Place
    command: list[str] = []
    creates: str = ""
    file: str = ""
    service: dict[str, Any] = {}


class Client(msgspec.Struct):
    """A client of a service or an action; type and name are empty if unknown."""

    kind: Literal["service", "action"]
    type: str
    name: str
    place: Place


class Unknown(msgspec.Struct):
    """The meaning of a mark ``$(unknown NUMBER)``."""

    what: str
    place: Place


class Failure(msgspec.Struct):
    """Why nothing was recorded."""

    place: Place
    message: str
    kind: Literal["syntax", "other", "raised"]


class RecordedFile(msgspec.Struct):
    """What a file does.

    Attributes:
        arguments: default values of launch arguments, by name.
        files: the files that were executed.
        shares: the share or source folders of packages that were looked up and exist.
        config: of a script, its configuration by key.
        steps: of a script, what it does around the launch.
        clients: the clients of services and actions that a script makes.
    """

    nodes: list[NodeAction] = []
    containers: list[ContainerAction] = []
    includes: list[IncludeAction] = []
    arguments: dict[str, str | None] = {}
    notes: list[Note] = []
    unknown: list[Unknown] = []
    files: list[str] = []
    shares: dict[str, str] = {}
    docstring: str = ""
    config: dict[str, Any] = {}
    config_place: Place = ("", 1)
    steps: list[Step] = []
    clients: list[Client] = []
    error: Failure | None = None


class UnusableFileError(R2bspecError):
    """A file cannot be read, ends with an exception, or is not of the expected kind."""

    def __init__(self, message: str, place: Place, code: str = _UNUSABLE) -> None:
        super().__init__(f"{place[0]}:{place[1]}: {message}", code=code)
        self.finding = Diagnostic(code, Severity.ERROR, message, span_of(place))


def span_of(place: Place) -> Span:
    """Return the place of a finding."""
    return Span(place[0], place[1], 1, place[1], 2)


def record(
    file: Path,
    kind: Kind,
    arguments: Mapping[str, str] | None = None,
    package_paths: Sequence[Path] = (),
    time_limit_s: float = TIME_LIMIT_S,
) -> RecordedFile:
    """Execute a file in a child process, and announce that on standard error.

    Args:
        file: the script or launch file, in Python.
        kind: which of both it is.
        arguments: values of launch arguments.
        package_paths: further folders with packages that it may import from.
        time_limit_s: when the child is killed.

    Raises:
        UnusableFileError: it cannot be read, ends with an exception, or is no such file.
    """
    place = (str(file), 1)
    if not is_regular(file):
        raise UnusableFileError(f"there is no such file; {path_hint(file)}", place)
    if file.stat().st_size > MAX_PYTHON_BYTES:
        raise UnusableFileError(f"it has more than {MAX_PYTHON_BYTES:,} bytes", place)
    what = "benchmark" if kind == "script" else "nodes"
    echo(f"executing {file} to read its {what}; stand-ins take the place of ROS", err=True)
    with temporary_folder("record") as scratch:
        result = scratch / "recorded.json"
        folders = [str(each.resolve()) for each in package_paths]
        given = [json.dumps(dict(arguments or {})), json.dumps(folders), "[]"]
        words = ["-P", "-m", "r2bspec.interop.recorder", str(file.resolve()), kind, str(result)]
        status = _run([sys.executable, *words, *given], time_limit_s)
        if status is None:
            raise UnusableFileError(f"it does not end within {time_limit_s:g} s", place)
        if not result.is_file() or result.stat().st_size > _MAX_RESULT_BYTES:
            raise UnusableFileError(f"it ends its process with status {status}", place)
        recorded = msgspec.json.decode(result.read_bytes(), type=RecordedFile)
    if recorded.error is not None:
        error = recorded.error
        code = _NOT_SUCH_A_FILE if error.kind == "other" else _UNUSABLE
        raise UnusableFileError(error.message, error.place, code)
    return recorded


def _run(words: Sequence[str], time_limit_s: float) -> int | None:
    """Run a program in a process group that ends with it; None if it exceeds the time."""
    quiet = subprocess.DEVNULL
    process = subprocess.Popen(
        words, stdin=quiet, stdout=quiet, stderr=quiet, start_new_session=True
    )
    try:
        return process.wait(timeout=time_limit_s)
    except subprocess.TimeoutExpired:
        return None
    finally:
        with contextlib.suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)
        process.wait()
