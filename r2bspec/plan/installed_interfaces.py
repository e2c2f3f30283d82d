"""The messages, services and actions of installed packages, read from their Python text.

Nothing is imported: the code that ROS generates names each type in the package's ``__init__``, and
the fields of a type as a literal in the file of the type.
"""

from __future__ import annotations

import ast
import contextlib
from collections.abc import Mapping

from r2bspec.plan.installed_packages import top_level_names
from r2bspec.plan.this_machine import find_module, module_file
from r2bspec.plan.wiring.python_files import read_python_file
from r2bspec.safe_io.shared_lookups import shared_lookup


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
