"""Python nodes whose class or function is not in their file or module."""

from __future__ import annotations

from pathlib import Path

from r2bspec.check.installed_packages import find_module, top_level_names
from r2bspec.check.python_target import PythonTarget, python_target
from r2bspec.check.rule_api import (
    Context,
    Finding,
    Findings,
    Rule,
    quote,
    suggestion,
    value_key,
)
from r2bspec.safe_io.safe_file import is_regular
from r2bspec.wiring.node_interface import reference_node_interfaces

_REFERENCE_NODES = "r2bspec.nodes"


def _find(context: Context) -> Findings:
    for _, node in context.nodes:
        if not node.node.python:
            continue
        target = python_target(node.node.python, context.loaded.base_dir)
        names = _names(target)
        if names is None or target.name in names:
            continue
        path = (*node.path, "python")
        # Another version of an installed module may have the name; files and the reference nodes
        # are the same on every machine.
        certain = not target.module or target.module == _REFERENCE_NODES
        yield Finding(
            message=f"{quote(target.module or target.text.rpartition(':')[0])} has no class or "
            f"function {quote(target.name)}",
            path=path,
            part=(len(target.text) - len(target.name), len(target.name)),
            help=suggestion(target.name, _public(names), "its classes and functions"),
            severity=None if certain else "warning",
            machine_dependent=not certain,
            suppressed_by={value_key(path)},
            suppresses={value_key(node.path)},
        )


def _names(target: PythonTarget) -> frozenset[str] | None:
    """The names of a file or module; None if they cannot be determined."""
    if target.module == _REFERENCE_NODES:
        return frozenset(name.rpartition(".")[2] for name in reference_node_interfaces())
    source = target.file if target.readable else None
    if target.module:
        found = find_module(target.module)
        origin = found.origin if found is not None else None
        source = Path(origin) if origin is not None and origin.endswith(".py") else None
    if source is None or not is_regular(source):
        return None
    try:
        return top_level_names(source)
    except SyntaxError:
        return None


def _public(names: frozenset[str]) -> list[str]:
    """The names that are likely to be nodes."""
    return [name for name in names if name[:1].isupper()] or [
        name for name in names if not name.startswith("_")
    ]


RULE = Rule(code="R2B625", find=_find, early=True)
