"""The messages, services and actions of installed packages, read from their Python text.

Nothing is imported: what ROS generates names each type in the package's ``__init__``, and the
fields of a type as a literal in the file of the type.
"""

from __future__ import annotations

import ast
from pathlib import Path

from r2bspec.plan.installed_packages import top_level_names
from r2bspec.plan.request_fields import FieldTypes
from r2bspec.plan.this_machine import find_module
from r2bspec.safe_io.limits import MAX_PYTHON_BYTES
from r2bspec.safe_io.looked_up_files import shared_lookup
from r2bspec.safe_io.safe_file import read_bytes

_FIELDS = "_fields_and_field_types"


@shared_lookup
def installed_types(package: str, kind: str) -> frozenset[str] | None:
    """The types of a kind (msg, srv, action) that a package has.

    Returns:
        None if they are unknown; empty if the package is not installed.
    """
    if find_module(package) is None:
        return frozenset()
    file = _python_file(f"{package}.{kind}", "__init__.py")
    try:
        return None if file is None else top_level_names(file)
    except SyntaxError:
        return None


@shared_lookup
def installed_fields(type_name: str) -> FieldTypes | None:
    """The fields of a type such as ``std_srvs/srv/SetBool_Request``; None if they are unknown."""
    folder, _, name = type_name.replace("/", ".").rpartition(".")
    names = _tree(_python_file(folder, "__init__.py"))
    module = next(
        (
            node.module
            for node in (names.body if names is not None else ())
            if isinstance(node, ast.ImportFrom) and name in (alias.name for alias in node.names)
        ),
        None,
    )
    tree = _tree(_python_file(module)) if module else None
    for node in tree.body if tree is not None else ():
        if isinstance(node, ast.ClassDef) and node.name == name:
            return _literal_fields(node)
    return None


def fields_of_message(type_name: str) -> FieldTypes | None:
    """The same for a message as fields name it: ``geometry_msgs/Pose``."""
    package, _, name = type_name.partition("/")
    return installed_fields(f"{package}/msg/{name}")


def _literal_fields(found: ast.ClassDef) -> FieldTypes | None:
    for node in found.body:
        match node:
            case ast.Assign(targets=[ast.Name(id=name)], value=ast.Dict() as value) if (
                name == _FIELDS
            ):
                return {
                    key.value: kind.value
                    for key, kind in zip(value.keys, value.values, strict=True)
                    if isinstance(key, ast.Constant)
                    and isinstance(kind, ast.Constant)
                    and isinstance(key.value, str)
                    and isinstance(kind.value, str)
                }
    return None


def _python_file(module: str, end: str = ".py") -> Path | None:
    found = find_module(module)
    origin = found.origin if found is not None else None
    return Path(origin) if origin is not None and origin.endswith(end) else None


def _tree(file: Path | None) -> ast.Module | None:
    try:
        return None if file is None else ast.parse(read_bytes(file, max_bytes=MAX_PYTHON_BYTES))
    except (OSError, SyntaxError, ValueError, RecursionError, MemoryError):
        return None
