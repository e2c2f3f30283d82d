"""Installed packages, programs, interfaces and Python sources, without importing or starting them.

The code that ROS generates for interfaces names each type in the package's ``__init__``, and the
fields of a type as a literal in the file of the type.
"""

from __future__ import annotations

import ast
import contextlib
import os
import re
import symtable
from collections.abc import Mapping
from pathlib import Path

import msgspec

from r2bspec.plan.this_machine import (
    AMENT_INDEX,
    PACKAGE_INDEX,
    ament_prefixes,
    find_module,
    module_file,
)
from r2bspec.plan.wiring.python_files import read_python_file, source_folder
from r2bspec.safe_io import safe_file
from r2bspec.safe_io.limits import MAX_MANIFEST_BYTES
from r2bspec.safe_io.shared_lookups import shared_lookup

_VERSION = re.compile(r"<version[^>]*>([^<]{1,100})</version>")
_STAR_IMPORT = re.compile(r"\bimport\s*\*")


@shared_lookup
def top_level_names(source: Path) -> frozenset[str] | None:
    """Return the names that a Python file defines; None if its text does not tell.

    Raises:
        SyntaxError: this interpreter cannot parse the file.
    """
    try:
        text = safe_file.read_bytes(source, max_bytes=MAX_MANIFEST_BYTES).decode("utf-8-sig")
        symbols = symtable.symtable(text, source.name, "exec").get_symbols()
    except (OSError, ValueError, RecursionError, MemoryError):
        return None
    names = {name.get_name() for name in symbols if name.is_assigned() or name.is_imported()}
    return None if "__getattr__" in names or _STAR_IMPORT.search(text) else frozenset(names)


@shared_lookup
def is_on_path(program: str) -> bool:
    """Return True if the folders of ``$PATH`` have a program of that name."""
    import shutil

    return shutil.which(program) is not None


@shared_lookup
def ament_packages() -> frozenset[str]:
    """Return the names of all installed ROS packages."""
    folders = (prefix / PACKAGE_INDEX for prefix in ament_prefixes())
    return frozenset(name for folder in folders for name in safe_file.names_if_any(folder))


@shared_lookup
def package_executables(package: str) -> frozenset[str]:
    """Return the names of the executables of a ROS package."""
    folders = (prefix / "lib" / package for prefix in ament_prefixes())
    return frozenset(
        name
        for folder in folders
        for name in safe_file.names_if_any(folder)
        if os.access(folder / name, os.X_OK)
    )


@shared_lookup
def package_plugins(package: str) -> set[str]:
    """Return the composable nodes that a ROS package registers."""
    plugins: set[str] = set()
    for prefix in ament_prefixes():
        entries = _text(prefix / AMENT_INDEX / "rclcpp_components" / package).splitlines()
        plugins.update(entry.partition(";")[0].strip() for entry in entries)
    return plugins - {""}


def installed_message_types() -> set[str]:
    """Return the message types of the installed ROS packages."""
    types: set[str] = set()
    for folder in (prefix / AMENT_INDEX / "rosidl_interfaces" for prefix in ament_prefixes()):
        for package in safe_file.names_if_any(folder):
            entries = _text(folder / package).splitlines()
            names = (entry.removesuffix(".msg") for entry in entries if entry.endswith(".msg"))
            types.update(f"{package}/{name}" for name in names if name.startswith("msg/"))
    return types


def _text(file: Path) -> str:
    """Return the text of a file of a package; empty without one."""
    try:
        return safe_file.read_bytes(file, max_bytes=MAX_MANIFEST_BYTES).decode("utf-8")
    except (OSError, ValueError):
        return ""


@shared_lookup
def package_share(package: str) -> Path | None:
    """Return the share folder of a ROS package, or None if it is not installed."""
    for prefix in ament_prefixes():
        if safe_file.is_there(prefix / PACKAGE_INDEX / package):
            return prefix / "share" / package
    return None


@shared_lookup
def package_version(package: str) -> str:
    """Return the version of an installed ROS package, from its package.xml; empty if unknown."""
    share = package_share(package) if package else None
    if share is None:
        return ""
    version = _VERSION.search(_text(share / "package.xml"))
    return version[1].strip() if version is not None else ""


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
    inside = safe_file.real_path(file).is_relative_to(safe_file.real_path(source_folder(base_dir)))
    return PythonTarget(text, "", file, name, readable=inside)


@shared_lookup
def installed_types(package: str, kind: str) -> frozenset[str] | None:
    """Return the types of a kind (msg, srv, action) that a package has.

    Returns:
        None if they are unknown; empty if the package is not installed.
    """
    if find_module(package) is None:
        return frozenset()
    file = module_file(f"{package}.{kind}")
    try:
        return None if file is None else top_level_names(file)
    except SyntaxError:
        return None


@shared_lookup
def installed_fields(type_name: str) -> Mapping[str, str] | None:
    """Return the fields of a type like ``std_srvs/srv/SetBool_Request``; None if unknown."""
    folder, _, name = type_name.replace("/", ".").rpartition(".")
    # The package does not name the parts of an action, which are in the file of the action.
    exported = name.partition("_")[0]
    for imported in _statements(folder):
        match imported:
            case ast.ImportFrom(module=str(module), names=names) if exported in {
                alias.name for alias in names
            }:
                return _literal_fields(module, name)
    return None


def _literal_fields(module: str, name: str) -> Mapping[str, str] | None:
    for node in _statements(module):
        for part in node.body if isinstance(node, ast.ClassDef) and node.name == name else ():
            match part:
                case ast.Assign(targets=[ast.Name(id="_fields_and_field_types")], value=value):
                    with contextlib.suppress(ValueError):
                        fields: Mapping[str, str] = ast.literal_eval(value)
                        return fields
    return None


def _statements(module: str) -> list[ast.stmt]:
    """Return the statements of a module; none if it is not found, or cannot be read."""
    file = module_file(module)
    tree = read_python_file(file) if file is not None else None
    return tree.body if tree is not None else []
