"""Installed modules and ROS packages, found without importing or starting anything."""

from __future__ import annotations

import ast
import contextlib
import importlib.util
import os
import re
import sys
from collections.abc import Iterator
from importlib.machinery import ModuleSpec, PathFinder
from pathlib import Path

from r2bspec.safe_io.looked_up_files import shared_lookup
from r2bspec.safe_io.safe_file import is_there, names_in, read_bytes

_MAX_SOURCE_BYTES = 1_000_000
_VERSION = re.compile(r"<version[^>]*>([^<]{1,100})</version>")
_INDEX = "share/ament_index/resource_index"
_PACKAGE_INDEX = f"{_INDEX}/packages"


@shared_lookup
def find_module(name: str) -> ModuleSpec | None:
    """Find a module by its dotted name, without importing its parent packages."""
    top, *below = name.split(".")
    try:
        found = PathFinder.find_spec(top, _unseen_folders()) or importlib.util.find_spec(top)
    except (ImportError, ValueError):
        found = None
    path = top
    for part in below:
        if found is None or found.submodule_search_locations is None:
            return None
        path = f"{path}.{part}"
        found = PathFinder.find_spec(path, list(found.submodule_search_locations))
    return found


def _unseen_folders() -> list[str]:
    """The folders of PYTHONPATH, where this interpreter ignores it (``-I``): processes do not."""
    if not sys.flags.ignore_environment:
        return []
    entries = (os.environ.get("PYTHONPATH") or "").split(os.pathsep)
    return [str(Path(each).absolute()) for each in entries if each]


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
    for each in ast.walk(part):
        if isinstance(each, ast.Name) and isinstance(each.ctx, ast.Store):
            yield each.id


@shared_lookup
def is_on_path(program: str) -> bool:
    """Whether the folders of ``$PATH`` have a program of that name."""
    import shutil

    return shutil.which(program) is not None


def ament_prefixes() -> list[Path]:
    """The folders in which ROS packages are installed."""
    prefixes = os.environ.get("AMENT_PREFIX_PATH") or ""
    return [Path(each) for each in prefixes.split(":") if each]


@shared_lookup
def ament_packages() -> frozenset[str]:
    """The names of all installed ROS packages."""
    found: set[str] = set()
    for prefix in ament_prefixes():
        with contextlib.suppress(OSError):
            found.update(names_in(prefix / _PACKAGE_INDEX))
    return frozenset(found)


@shared_lookup
def package_executables(package: str) -> frozenset[str]:
    """The names of the executables of a ROS package."""
    found: set[str] = set()
    for prefix in ament_prefixes():
        folder = prefix / "lib" / package
        with contextlib.suppress(OSError):
            found.update(each for each in names_in(folder) if os.access(folder / each, os.X_OK))
    return frozenset(found)


def package_plugins(package: str) -> set[str]:
    """The composable nodes that a ROS package registers."""
    found: set[str] = set()
    for prefix in ament_prefixes():
        entries = _index_text(prefix / _INDEX / "rclcpp_components" / package).splitlines()
        found.update(each.partition(";")[0].strip() for each in entries)
    return found - {""}


def installed_message_types() -> set[str]:
    """The message types of the installed ROS packages."""
    found: set[str] = set()
    for prefix in ament_prefixes():
        try:
            packages = list((prefix / _INDEX / "rosidl_interfaces").iterdir())
        except OSError:
            continue
        for package in packages:
            entries = _index_text(package).splitlines()
            names = (each.removesuffix(".msg") for each in entries if each.endswith(".msg"))
            found.update(f"{package.name}/{each}" for each in names if each.startswith("msg/"))
    return found


def _index_text(entry: Path) -> str:
    """The text of an entry of the index; empty without one."""
    try:
        return read_bytes(entry, max_bytes=_MAX_SOURCE_BYTES).decode("utf-8")
    except (OSError, ValueError):
        return ""


@shared_lookup
def package_share(package: str) -> Path | None:
    """The share folder of a ROS package, or None if it is not installed."""
    for prefix in ament_prefixes():
        if is_there(prefix / _PACKAGE_INDEX / package):
            return prefix / "share" / package
    return None


@shared_lookup
def package_version(package: str) -> str:
    """The version of an installed ROS package, from its package.xml; empty if unknown."""
    share = package_share(package) if package else None
    if share is None:
        return ""
    try:
        text = read_bytes(share / "package.xml", max_bytes=_MAX_SOURCE_BYTES).decode("utf-8")
    except (OSError, ValueError):
        return ""
    found = _VERSION.search(text)
    return found[1].strip() if found is not None else ""
