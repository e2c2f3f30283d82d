"""Installed packages, programs and Python sources, without importing or starting anything."""

from __future__ import annotations

import os
import re
import symtable
from pathlib import Path

import msgspec

from r2bspec.plan.this_machine import AMENT_INDEX, PACKAGE_INDEX, ament_prefixes
from r2bspec.plan.wiring.python_files import source_folder
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
