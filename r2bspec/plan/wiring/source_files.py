"""The classes and functions that a Python file names, where it imports them from its own package.

Nothing is imported: files are found by the names of their modules, beside the file that names them.
"""

from __future__ import annotations

import ast
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

from r2bspec.plan.wiring.python_package import module_of
from r2bspec.plan.wiring.python_source import SourceNames
from r2bspec.safe_io.limits import MAX_BASE_CLASSES

ReadSource = Callable[[Path], ast.Module | None]


class SourceFile(NamedTuple):
    """A Python file.

    Attributes:
        tree: its syntax.
        names: what it binds.
        path: absolute; None for a text of which nothing else is known.
        read: reads another file of its package; None if it may not be read.
    """

    tree: ast.Module
    names: SourceNames
    path: Path | None
    read: ReadSource


class Definition(NamedTuple):
    """A class or a function, and the file that defines it."""

    file: SourceFile
    node: ast.ClassDef | ast.FunctionDef


def source_file(
    tree: ast.Module, path: Path | None = None, read: ReadSource = lambda _: None
) -> SourceFile:
    """A file with its names."""
    return SourceFile(tree, SourceNames(tree), path, read)


def find_definition(file: SourceFile, name: str) -> Definition | None:
    """What a name at the top level of a file means, also if the file imports it."""
    for _ in range(MAX_BASE_CLASSES):
        found = file.names.definition(name)
        if found is not None:
            return Definition(file, found)
        origin = file.names.imported_from(name)
        path = None if origin is None or file.path is None else _module_file(file.path, *origin[:2])
        tree = None if path is None else file.read(path)
        if origin is None or tree is None:
            return None
        file, name = source_file(tree, path, file.read), origin[2]
    return None


def _module_file(importing: Path, level: int, module: str) -> Path | None:
    """The file of a module of the same package, or beside it; None if there is none."""
    folder = importing.parent if level else module_of(importing).folder
    for _ in range(level - 1):
        folder = folder.parent
    place = folder.joinpath(*module.split(".")) if module else folder
    files = (place.with_name(f"{place.name}.py"), place / "__init__.py")
    return next((file for file in files if file.is_file()), None)
