"""Python files of nodes: where they may be read, as modules of their package, and their names.

Nothing is imported: a module is found by its name in the folder of the importing file. A node named
by its file, such as ``../src/pkg/pkg/node.py:Node``, is a module of its package, so that it may
import other modules of it: ``from pkg.helper import …``, ``from . import …``.
"""

from __future__ import annotations

import ast
import itertools
from collections.abc import Callable
from functools import lru_cache
from pathlib import Path
from typing import NamedTuple, TypeVar

from r2bspec.plan.wiring.python_source import SourceNames
from r2bspec.safe_io import safe_file
from r2bspec.safe_io.git import find_work_tree
from r2bspec.safe_io.limits import MAX_BASE_CLASSES, MAX_PYTHON_BYTES
from r2bspec.safe_io.looked_up_files import shared_lookup

_INIT = "__init__.py"
_MAX_KEPT_BYTES = 10_000
_MAX_FOLDERS = 500
"""How many folders below ``src`` are looked at for a package."""

ReadSource = Callable[[Path], ast.Module | None]


@shared_lookup
def source_folder(base_dir: Path) -> Path:
    """Return where sources may be read: the work tree or workspace of a spec, or its folder."""
    return find_work_tree(base_dir) or _find_workspace(base_dir) or base_dir


def _find_workspace(base_dir: Path) -> Path | None:
    """Return the innermost folder around a spec whose ``src`` has a package; None without one."""
    start = safe_file.real_path(base_dir)
    return next((top for top in (start, *start.parents) if _has_packages(top / "src")), None)


def _has_packages(folder: Path) -> bool:
    """Return whether a folder of a folder is a package, or a repository of packages."""
    places = [folder / name for name in safe_file.names_if_any(folder)[:_MAX_FOLDERS]]
    inner = (place / name for place in places for name in safe_file.names_if_any(place))
    deeper = itertools.islice(inner, _MAX_FOLDERS)
    return any(safe_file.is_regular(each / "package.xml") for each in (*places, *deeper))


class PackageModule(NamedTuple):
    """A file as a module.

    Attributes:
        folder: what has to be searched for modules, so that it is found under its name.
        name: dotted.
        package: the dotted name of its package; empty if it is in none.
    """

    folder: Path
    name: str
    package: str


def module_of(file: Path) -> PackageModule:
    """Return the name of a file as a module.

    Its folders up to the first without ``__init__.py`` count.

    Args:
        file: absolute, without links. A ``__init__.py`` is the module of its folder's name.
    """
    folder = file.parent
    parts: list[str] = []
    while folder.name.isidentifier() and (folder / _INIT).is_file():
        parts.insert(0, folder.name)
        folder = folder.parent
    package = ".".join(parts)
    if not parts or file.name == _INIT:
        return PackageModule(folder, package or file.stem, package)
    return PackageModule(folder, f"{package}.{file.stem}", package)


def read_python_file(
    source: Path, folder: Path | None = None, budget: safe_file.ByteBudget | None = None
) -> ast.Module | None:
    """Return the syntax tree of a Python file, or None if it cannot be read.

    Args:
        source: the file.
        folder: where the file must be; by default anywhere.
        budget: what this file and others may have together.
    """
    folders = None if folder is None else (folder,)
    try:
        content = safe_file.read_bytes(
            source, max_bytes=MAX_PYTHON_BYTES, folders=folders, budget=budget
        )
        return _parsed(content) if len(content) <= _MAX_KEPT_BYTES else ast.parse(content)
    except (OSError, SyntaxError, ValueError, RecursionError, MemoryError):
        return None


@lru_cache(maxsize=8)
def _parsed(content: bytes) -> ast.Module:
    """Return the tree of a text that many specs name, or that an editor reads again and again."""
    return ast.parse(content)


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


@lru_cache(maxsize=32)
def source_file(
    tree: ast.Module, path: Path | None = None, read: ReadSource = lambda _: None
) -> SourceFile:
    """Return a file with its names."""
    return SourceFile(tree, SourceNames(tree), path, read)


_Found = TypeVar("_Found")


def find_definition(file: SourceFile, name: str) -> Definition | None:
    """Return the definition of a top-level name of a file, following imports."""
    found: tuple[SourceFile, ast.ClassDef | ast.FunctionDef] | None
    found = _find(file, name, SourceNames.definition)
    return None if found is None else Definition(*found)


def find_constant(file: SourceFile, name: str) -> tuple[SourceFile, ast.expr] | None:
    """Return the value of a top-level variable of a file, following imports."""
    return _find(file, name, SourceNames.constant)


def _find(
    file: SourceFile,
    name: str,
    look: Callable[[SourceNames, str], _Found | None],
    steps: int = MAX_BASE_CLASSES,
) -> tuple[SourceFile, _Found] | None:
    """Return what a name means, and the file that says it."""
    if (found := look(file.names, name)) is not None:
        return file, found
    for level, module, own in file.names.imported_from(name) if steps else ():
        imported = _read_module(file, level, module)
        known = None if imported is None else _find(imported, own, look, steps - 1)
        if known is not None:
            return known
    return None


def find_module(file: SourceFile, given: ast.expr) -> SourceFile | None:
    """Return the file of a module of the same package that an expression names."""
    if full := file.names.full_name(given):
        return _read_module(file, 0, full)
    match given:
        case ast.Name(id=name):
            for level, module, own in file.names.imported_from(name):
                return _read_module(file, level, f"{module}.{own}".strip("."))
    return None


def _read_module(file: SourceFile, level: int, module: str) -> SourceFile | None:
    path = None if file.path is None else _module_file(file.path, level, module)
    tree = None if path is None else file.read(path)
    return None if tree is None else source_file(tree, path, file.read)


def _module_file(importing: Path, level: int, module: str) -> Path | None:
    """Return the file of a module of the same package, or beside it; None if there is none."""
    folder = importing.parent if level else module_of(importing).folder
    for _ in range(level - 1):
        folder = folder.parent
    place = folder.joinpath(*module.split(".")) if module else folder
    files = (place.with_name(f"{place.name}.py"), place / "__init__.py")
    return next((file for file in files if file.is_file()), None)
