"""Installed packages, programs and Python sources, without importing or starting anything."""

from __future__ import annotations

import ast
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import NamedTuple

import msgspec

from r2bspec.plan.this_machine import find_module
from r2bspec.safe_io.looked_up_files import shared_lookup
from r2bspec.safe_io.safe_file import (
    is_folder,
    is_regular,
    read_bytes,
    real_path,
)
from r2bspec.wiring.companion_files import source_folder
from r2bspec.wiring.python_package import module_of

_MAX_SOURCE_BYTES = 1_000_000


@shared_lookup
def top_level_names(source: Path) -> frozenset[str] | None:
    """The names that a Python file defines, or None if its text does not determine them.

    Raises:
        SyntaxError: this interpreter cannot parse the file.
    """
    try:
        tree = ast.parse(read_bytes(source, max_bytes=_MAX_SOURCE_BYTES))
        names = set(_bound_names(tree.body))
    except (OSError, ValueError, RecursionError, MemoryError):
        return None
    return None if names & {"*", "__getattr__"} else frozenset(names)


def _bound_names(body: list[ast.stmt]) -> Iterator[str]:
    """The names that statements bind, including those in ``if``, ``try`` and ``with``."""
    # Without recursion: each `elif` is one level deeper than the one before.
    waiting: list[ast.AST] = list(body)
    while waiting:
        match statement := waiting.pop():
            case ast.FunctionDef() | ast.AsyncFunctionDef() | ast.ClassDef():
                yield statement.name
            case ast.Import() | ast.ImportFrom():
                for alias in statement.names:
                    yield (alias.asname or alias.name).partition(".")[0]
            case ast.ExceptHandler():
                waiting.extend(statement.body)
            case _:
                for part in ast.iter_child_nodes(statement):
                    if isinstance(part, ast.stmt | ast.ExceptHandler):
                        waiting.append(part)
                    else:
                        yield from _assigned_names(part)


def _assigned_names(part: ast.AST) -> Iterator[str]:
    for node in ast.walk(part):
        if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
            yield node.id


@shared_lookup
def is_on_path(program: str) -> bool:
    """Whether the folders of ``$PATH`` have a program of that name."""
    import shutil

    return shutil.which(program) is not None


class PythonTarget(msgspec.Struct, frozen=True):
    """A class or function in a module or a file.

    Attributes:
        text: as in the spec.
        module: the dotted name; empty for a file.
        file: the path of the file; unused for a module.
        name: the class or function.
        readable: whether the file is in the work tree, so that it may be read.
    """

    text: str
    module: str
    file: Path
    name: str
    readable: bool


def python_target(text: str, base_dir: Path) -> PythonTarget:
    """Parse ``module.Class`` or ``./file.py:Class``."""
    place, colon, name = text.rpartition(":")
    if not colon:
        module, _, name = text.rpartition(".")
        return PythonTarget(text, module, Path(), name, readable=False)
    file = base_dir / place
    inside = real_path(file).is_relative_to(real_path(source_folder(base_dir)))
    return PythonTarget(text, "", file, name, readable=inside)


class ModuleImport(NamedTuple):
    """A top-level module that a file imports, and the line of the first import."""

    module: str
    line: int


def missing_imports(file: Path, folder: Path) -> list[ModuleImport]:
    """The modules that a file certainly imports and that are not found, in the order of lines.

    Neither the file nor anything that it imports is executed.

    Args:
        file: the Python file; its own folder and that of its package are searched, too.
        folder: where the file must be.
    """
    try:
        tree = ast.parse(read_bytes(file, max_bytes=_MAX_SOURCE_BYTES, folders=(folder,)))
    except (OSError, SyntaxError, ValueError, RecursionError, MemoryError):
        return []
    imports: dict[str, ModuleImport] = {}
    for imported in _imports(tree.body):
        imports.setdefault(imported.module, imported)
    folders = {file.parent, module_of(file.resolve()).folder}
    return [imported for imported in imports.values() if not _is_found(imported.module, folders)]


def _imports(body: list[ast.stmt]) -> Iterator[ModuleImport]:
    """The imports among statements; one in a branch, a `try` or a function may be optional."""
    for statement in body:
        match statement:
            case ast.Import():
                for alias in statement.names:
                    yield ModuleImport(alias.name.partition(".")[0], statement.lineno)
            case ast.ImportFrom(module=str(module), level=0):
                yield ModuleImport(module.partition(".")[0], statement.lineno)


def _is_found(module: str, folders: Iterable[Path]) -> bool:
    beside = any(
        is_regular(folder / f"{module}.py") or is_folder(folder / module) for folder in folders
    )
    return beside or find_module(module) is not None
