"""The modules that a Python file imports whenever it is imported, read from its text."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from r2bspec.check.installed_packages import find_module
from r2bspec.safe_io.safe_file import is_folder, is_regular, read_bytes

_MAX_SOURCE_BYTES = 1_000_000


class ModuleImport(NamedTuple):
    """A top-level module that a file imports, and the line of the first import."""

    module: str
    line: int


def missing_imports(file: Path, folder: Path) -> list[ModuleImport]:
    """The modules that a file certainly imports and that are not found, in the order of lines.

    Neither the file nor anything that it imports is executed.

    Args:
        file: the Python file; its own folder is searched, too.
        folder: where the file must be.
    """
    try:
        tree = ast.parse(read_bytes(file, max_bytes=_MAX_SOURCE_BYTES, folders=(folder,)))
    except (OSError, SyntaxError, ValueError, RecursionError, MemoryError):
        return []
    found: dict[str, ModuleImport] = {}
    for each in _imports(tree.body):
        found.setdefault(each.module, each)
    return [each for each in found.values() if not _is_found(each.module, file.parent)]


def _imports(body: list[ast.stmt]) -> Iterator[ModuleImport]:
    """The imports among statements; one in a branch, a `try` or a function may be optional."""
    for statement in body:
        match statement:
            case ast.Import():
                for alias in statement.names:
                    yield ModuleImport(alias.name.partition(".")[0], statement.lineno)
            case ast.ImportFrom(module=str(module), level=0):
                yield ModuleImport(module.partition(".")[0], statement.lineno)


def _is_found(module: str, folder: Path) -> bool:
    return (
        is_regular(folder / f"{module}.py")
        or is_folder(folder / module)
        or find_module(module) is not None
    )
