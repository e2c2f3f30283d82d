"""Finding and reading Python files as data: the script, and modules next to it."""

from __future__ import annotations

import ast
import sys
import warnings
from collections.abc import Iterator, Sequence
from pathlib import Path

from r2bspec.diagnostics import Diagnostic, Severity, Span
from r2bspec.interop.script_import.script_limits import (
    MAX_FILE_BYTES,
    MAX_TOTAL_BYTES,
    StepCounter,
)
from r2bspec.interop.script_import.script_values import ScriptModule
from r2bspec.untrusted import safe_file

UNREADABLE = "R2B701"
SYNTAX = "R2B702"
TOO_COMPLEX = "R2B703"

_MAX_ANCESTORS = 4
_NEVER_READ = frozenset(
    {
        "launch",
        "launch_ros",
        "launch_testing",
        "ros2_benchmark",
        "ament_index_python",
        "rclpy",
        "model_converter",
    }
)
"""Packages and modules whose meaning is known; reading them would tell nothing."""


class UnusableScriptError(Exception):
    """A script that cannot be evaluated at all; `finding` says why."""

    def __init__(self, finding: Diagnostic) -> None:
        super().__init__(finding.message)
        self.finding = finding

    @classmethod
    def of_limit(cls, file: Path, reason: str) -> UnusableScriptError:
        """For a file whose evaluation exceeds a limit."""
        message = f"the file needs more than is evaluated: {reason}"
        return _unusable(TOO_COMPLEX, message, Span.of_file(str(file)))


class ScriptReader:
    """Reads the files of one import, each once, with a limit on all together.

    Args:
        script: the file that is imported; modules are searched for in its folder and above.
        package_paths: further folders that contain packages.
    """

    def __init__(self, script: Path, package_paths: Sequence[Path] = ()) -> None:
        self._budget = safe_file.ByteBudget(MAX_TOTAL_BYTES)
        self._modules: dict[Path, ScriptModule | None] = {}
        self.texts: dict[str, str] = {}
        self.steps = StepCounter()
        here = safe_file.real_path(script).parent
        above = [each for each in here.parents if each != Path(each.anchor)]
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
            raise _unusable(SYNTAX, f"invalid Python syntax: {error.msg}", span) from error
        except (ValueError, RecursionError, MemoryError) as error:
            message = "the file cannot be parsed: it is nested too deeply, or contains NUL"
            raise _unusable(SYNTAX, message, Span.of_file(str(file))) from error
        return ScriptModule(file, text, tree)

    def read_text(self, file: Path) -> str:
        """Read a file.

        Raises:
            UnusableScriptError: it cannot be read.
        """
        try:
            text = safe_file.read_text(file, max_bytes=MAX_FILE_BYTES, budget=self._budget)
        except OSError as error:
            reason = error.strerror or str(error)
            raise _unusable(
                UNREADABLE, f"{file} cannot be read: {reason}", Span.of_file(str(file))
            ) from error
        self.texts[str(file)] = text
        return text

    def find_module(self, name: str) -> ScriptModule | None:
        """A module next to the script or in a folder above, by its full name; None without one."""
        first = name.partition(".")[0]
        if not name or first in _NEVER_READ or first in sys.stdlib_module_names:
            return None
        for file in self._candidates(name):
            found = self._read_once(file)
            if found is not None:
                return found
        return None

    def find_sibling(self, folder: Path, name: str) -> ScriptModule | None:
        """A module of the package in a folder, as for ``from .name import``; None without one."""
        if name in _NEVER_READ:
            return None
        inside = folder.joinpath(*name.split(".")) if name else folder
        for file in (inside.with_suffix(".py"), inside / "__init__.py"):
            if any(file.is_relative_to(root) for root in self._roots):
                found = self._read_once(file)
                if found is not None:
                    return found
        return None

    def find_share_file(self, package: str, file: str) -> Path | None:
        """A file of a package whose source folder is next to the script or above."""
        if not package or ".." in Path(file).parts or Path(file).is_absolute():
            return None
        for root in self._roots:
            folders = [root / package] if root.name != package else [root, root / package]
            for folder in folders:
                if safe_file.is_regular(folder / file):
                    return folder / file
        return None

    def _candidates(self, name: str) -> Iterator[Path]:
        inside = Path(*name.split("."))
        first = inside.parts[0]
        for root in self._roots:
            for folder in (root, root / first):
                yield (folder / inside).with_suffix(".py")
                yield folder / inside / "__init__.py"

    def _read_once(self, file: Path) -> ScriptModule | None:
        if file not in self._modules:
            self._modules[file] = None
            if safe_file.is_regular(file):
                try:
                    self._modules[file] = self.read(file)
                except UnusableScriptError:
                    return None
        return self._modules[file]


def _unusable(code: str, message: str, span: Span) -> UnusableScriptError:
    return UnusableScriptError(Diagnostic(code, Severity.ERROR, message, span))
