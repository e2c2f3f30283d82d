"""The messages, services and actions of installed packages, read from their Python text.

Nothing is imported: the code that ROS generates names each type in the package's ``__init__``, and
the fields of a type as a literal in the file of the type.
"""

from __future__ import annotations

import ast
from typing import Any

from r2bspec.plan.installed_packages import top_level_names
from r2bspec.plan.request_fields import FieldTypes
from r2bspec.plan.this_machine import find_module, module_file
from r2bspec.plan.wiring.python_files import read_python_file
from r2bspec.safe_io.looked_up_files import shared_lookup

_FIELDS = "_fields_and_field_types"
_CONSTANTS = "__constants"


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
def installed_fields(type_name: str) -> FieldTypes | None:
    """Return the fields of a type like ``std_srvs/srv/SetBool_Request``; None if unknown."""
    return _literal_of(type_name, "", _FIELDS)


def fields_of_message(type_name: str) -> FieldTypes | None:
    """Return the fields of a message by the name that fields use: ``geometry_msgs/Pose``."""
    return installed_fields(type_name.replace("/", "/msg/"))


def _literal_of(type_name: str, prefix: str, attribute: str) -> dict[str, Any] | None:
    """Return a literal map in the class of a type, or of one whose name has a prefix."""
    folder, _, name = type_name.replace("/", ".").rpartition(".")
    # The package does not name the parts of an action, which are in the file of the action.
    exported = name.partition("_")[0]
    for imported in _statements(folder):
        if isinstance(imported, ast.ImportFrom) and exported in (
            alias.name for alias in imported.names
        ):
            for node in _statements(imported.module or ""):
                if isinstance(node, ast.ClassDef) and node.name == f"{prefix}{name}":
                    return _literal_map(node, attribute)
            return None
    return None


def _literal_map(found: ast.ClassDef, attribute: str) -> dict[str, Any] | None:
    for node in found.body:
        match node:
            case ast.Assign(targets=[ast.Name(id=name)], value=ast.Dict() as value) if (
                name == attribute
            ):
                return {
                    key.value: _constant(kind)
                    for key, kind in zip(value.keys, value.values, strict=True)
                    if isinstance(key, ast.Constant) and isinstance(key.value, str)
                }
    return None


def _constant(node: ast.expr) -> Any:
    try:
        return ast.literal_eval(node)
    except ValueError:
        return None


def _statements(module: str) -> list[ast.stmt]:
    """Return the statements of a module; none if it is not found, or cannot be read."""
    file = module_file(module) if module else None
    tree = read_python_file(file) if file is not None else None
    return tree.body if tree is not None else []
