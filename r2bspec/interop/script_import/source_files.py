"""The files of one import: found, read once, and parsed as data with a limit on all together.

Modules are searched for next to the script, in folders above, and in further folders that the user
names. Nothing is imported. Comments are kept by line: what an author wrote above a node goes into
the spec.
"""

from __future__ import annotations

import ast
import io
import os
import sys
import tokenize
import warnings
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

from r2bspec.diagnostics import Diagnostic, Severity, Span
from r2bspec.interop.script_import.values import ScriptModule, StepCounter
from r2bspec.safe_io import safe_file
from r2bspec.safe_io.limits import MAX_PYTHON_BYTES, MAX_SCRIPT_BYTES

UNREADABLE: Final = "R2B701"
SYNTAX: Final = "R2B702"
TOO_COMPLEX: Final = "R2B703"
NOT_A_BENCHMARK: Final = "R2B704"
MODULE_MISSING: Final = "R2B705"

_MAX_ANCESTORS: Final = 4
_KNOWN_PACKAGES: Final = frozenset(
    {
        *("launch", "launch_ros", "launch_testing", "rclpy", "ament_index_python"),
        *("ros2_benchmark", "model_converter"),
    }
)
"""Packages and modules whose meaning is known; reading them would tell nothing."""


_HELP: Final = {
    UNREADABLE: "give a regular file in UTF-8 that you may read",
    SYNTAX: "correct it there; Python ('python3 -m py_compile') or 'ros2 launch' must accept it",
    NOT_A_BENCHMARK: "give a script as ros2_benchmark has them; 'r2bspec init NAME --from-launch "
    "FILE' reads a launch file as ROS 2 has them",
    TOO_COMPLEX: "import a simpler file, or write the spec: 'r2bspec init'",
}


class UnusableScriptError(Exception):
    """A script that cannot be evaluated at all; `finding` says why."""

    def __init__(self, code: str, message: str, span: Span, advice: str = "") -> None:
        super().__init__(message)
        self.finding = Diagnostic(code, Severity.ERROR, message, span, help=advice or _HELP[code])


def unusable(
    message: str, module: ScriptModule, line: int, code: str = NOT_A_BENCHMARK, advice: str = ""
) -> UnusableScriptError:
    """The error for a script, at one of its lines; by default with the advice of its code."""
    length = len(module.text.splitlines()[line - 1]) if module.text else 0
    span = Span(str(module.file), line, 1, line, length + 1)
    return UnusableScriptError(code, message, span, advice)


class ScriptReader:
    """Reads the files of one import, each once, with a limit on all together.

    Args:
        script: the file that is imported; modules are searched for in its folder and above.
        package_paths: further folders that contain packages.
    """

    def __init__(self, script: Path, package_paths: Sequence[Path] = ()) -> None:
        self._budget = safe_file.ByteBudget(MAX_SCRIPT_BYTES)
        self._modules: dict[Path, ScriptModule | None] = {}
        self.texts: dict[str, str] = {}
        self.steps = StepCounter()
        here = safe_file.real_path(script).parent
        above = [folder for folder in here.parents if folder != Path(folder.anchor)]
        self._roots = (here, *above[:_MAX_ANCESTORS], *package_paths)

    def read(self, file: Path) -> ScriptModule:
        """Read and parse a file.

        Raises:
            UnusableScriptError: it cannot be read, or is not Python.
        """
        text = self.read_text(file)
        try:
            with warnings.catch_warnings():
                # Of odd literals; the file is not ours.
                warnings.simplefilter("ignore")
                tree = ast.parse(text)
        except SyntaxError as error:
            line, column = error.lineno or 1, max(1, error.offset or 1)
            span = Span(str(file), line, column, line, column + 1)
            message = f"invalid Python syntax: {error.msg}"
            raise UnusableScriptError(SYNTAX, message, span) from error
        except (ValueError, RecursionError, MemoryError) as error:
            message = "the file cannot be parsed: it is nested too deeply"
            raise UnusableScriptError(SYNTAX, message, Span.of_file(str(file))) from error
        module = ScriptModule(file, text, tree)
        module.scope.names["__file__"] = self.reference(file)
        return module

    def reference(self, file: Path) -> str:
        """A file as a reference to the folder of the script, ``$(script)``."""
        return "$(script)/" + os.path.relpath(safe_file.real_path(file), self._roots[0])

    def referenced(self, path: str) -> Path:
        """The file of such a reference."""
        return self._roots[0] / path.removeprefix("$(script)/")

    def read_text(self, file: Path) -> str:
        """Read a file.

        Raises:
            UnusableScriptError: it cannot be read, or is no text in UTF-8.
        """
        try:
            text = safe_file.read_text(file, max_bytes=MAX_PYTHON_BYTES, budget=self._budget)
        except OSError as error:
            message = f"{file} cannot be read: {error.strerror or error}"
            raise UnusableScriptError(UNREADABLE, message, Span.of_file(str(file))) from error
        self.texts[str(file)] = text
        if "\0" in text:
            message = f"{file} cannot be read: it has NUL characters, as text in UTF-16 has"
            raise UnusableScriptError(UNREADABLE, message, Span.of_file(str(file)))
        return text

    def find_module(self, name: str) -> ScriptModule | None:
        """A module next to the script or in a folder above, by its full name; None without one."""
        if not name or not _is_of_the_script(name):
            return None
        return self._first_module(self._candidates(name))

    def find_sibling(self, folder: Path, name: str) -> ScriptModule | None:
        """A module of the package in a folder, as for ``from .name import``; None without one."""
        if name in _KNOWN_PACKAGES:
            return None
        inside = folder.joinpath(*name.split(".")) if name else folder
        files = (inside.with_suffix(".py"), inside / "__init__.py")
        return self._first_module(
            file for file in files if any(file.is_relative_to(root) for root in self._roots)
        )

    def find_package(self, package: str) -> Path | None:
        """The source folder of a package that is next to the script or above."""
        folders = self._package_folders(package)
        return next((each for each in folders if safe_file.is_regular(each / "package.xml")), None)

    def find_share_file(self, package: str, file: str) -> Path | None:
        """A file of a package whose source folder is next to the script or above."""
        if not package or ".." in Path(file).parts or Path(file).is_absolute():
            return None
        files = (folder / file for folder in self._package_folders(package))
        return next(filter(safe_file.is_regular, files), None)

    def _package_folders(self, package: str) -> Iterator[Path]:
        """The folders that may be the source of a package."""
        for root in self._roots:
            if root.name == package:
                yield root
            yield root / package

    def _candidates(self, name: str) -> Iterator[Path]:
        inside = Path(*name.split("."))
        for root in self._roots:
            for folder in (root, root / inside.parts[0]):
                yield (folder / inside).with_suffix(".py")
                yield folder / inside / "__init__.py"

    def _first_module(self, files: Iterator[Path]) -> ScriptModule | None:
        return next(filter(None, map(self._read_once, files)), None)

    def _read_once(self, file: Path) -> ScriptModule | None:
        if file not in self._modules:
            self._modules[file] = None
            if safe_file.is_regular(file):
                try:
                    self._modules[file] = self.read(file)
                except UnusableScriptError:
                    return None
        return self._modules[file]


def missing_module(name: str) -> str:
    """The module of something foreign that was not found beside a script; empty for a known one."""
    module, dot, _ = name.partition(".")
    return module if dot and _is_of_the_script(module) else ""


def _is_of_the_script(name: str) -> bool:
    first = name.partition(".")[0]
    known = first in _KNOWN_PACKAGES or first in sys.stdlib_module_names
    return not known and first != "builtins"


@dataclass(slots=True)
class ScriptComments:
    """The comments of a Python file by the line that they are on.

    Attributes:
        file: the file, as places name it.
        own: comments that are alone on their line.
        trailing: comments at the end of a line with code.
    """

    file: str = ""
    own: dict[int, str] = field(default_factory=dict)
    trailing: dict[int, str] = field(default_factory=dict)

    def at(self, place: Span) -> list[str]:
        """The comment directly above a place, and the one at its end; none for other files."""
        if place.file != self.file:
            return []
        comments: list[str] = []
        above = place.line - 1
        while above in self.own:
            comments.insert(0, self.own[above])
            above -= 1
        return comments + ([self.trailing[place.line]] if place.line in self.trailing else [])

    def head(self) -> list[str]:
        """The comment at the beginning of the file: its licence."""
        line = 1
        while line in self.own:
            line += 1
        return [self.own[at] for at in range(1, line) if not self.own[at].startswith("!")]


def read_comments(file: Path, text: str) -> ScriptComments:
    """The comments of a Python file; those after a part that is no Python are left out."""
    comments = ScriptComments(str(file))
    try:
        for token in tokenize.generate_tokens(io.StringIO(text).readline):
            if token.type == tokenize.COMMENT:
                alone = not token.line[: token.start[1]].strip()
                lines = comments.own if alone else comments.trailing
                lines[token.start[0]] = token.string.lstrip("#").strip()
    except (tokenize.TokenError, SyntaxError):
        return comments
    return comments
