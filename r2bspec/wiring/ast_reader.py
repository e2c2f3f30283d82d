"""Reading a node's topics and parameters from its Python source, without running it.

A class is supported if its only base class is `Node`, and if every call of `create_publisher`,
`create_subscription` and `declare_parameter` on `self` has literal arguments and is outside of
loops and branches. Otherwise its publishers, subscriptions or parameters are unknown.
"""

from __future__ import annotations

import ast
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

from r2bspec.language.spec import QoS
from r2bspec.untrusted.safe_file import ByteBudget, read_bytes
from r2bspec.wiring.node_interface import InterfaceEntry, ParameterInfo, ParameterType

_MAX_FILE_BYTES = 300_000
"""The parser needs up to 700 bytes of memory for each byte."""
_CONDITIONAL_NODES = (
    ast.If,
    ast.For,
    ast.AsyncFor,
    ast.While,
    ast.Try,
    ast.Match,
    ast.IfExp,
    ast.Lambda,
)
_TYPES: dict[type, ParameterType] = {
    bool: "bool",
    int: "integer",
    float: "double",
    str: "string",
}


@dataclass
class _PartialInterface:
    """The interface so far; a part becomes None with the first call that is not literal."""

    topics: dict[str, dict[str, str] | None] = field(
        default_factory=lambda: {"create_publisher": {}, "create_subscription": {}}
    )
    parameters: dict[str, ParameterInfo] | None = field(default_factory=dict)
    qos: dict[str, QoS] = field(default_factory=dict)


def read_node_source(
    source: Path, name: str, folder: Path | None = None, budget: ByteBudget | None = None
) -> InterfaceEntry | None:
    """The interface of the class `name` in a file, or None if it is unknown.

    Args:
        source: the file.
        name: the class.
        folder: where the file must be; by default anywhere.
        budget: what this file and others may have together.
    """
    folders = None if folder is None else (folder,)
    try:
        content = read_bytes(source, max_bytes=_MAX_FILE_BYTES, folders=folders, budget=budget)
        tree = ast.parse(content)
        return _read(tree, name)
    except (OSError, SyntaxError, ValueError, RecursionError, MemoryError):
        return None


def _read(tree: ast.Module, name: str) -> InterfaceEntry | None:
    found = next(
        (each for each in tree.body if isinstance(each, ast.ClassDef) and each.name == name), None
    )
    if found is None:
        return None
    imported = _import_names(tree)
    if not _is_plain_node(found, imported) or _leaks_self(found):
        return None
    result = _PartialInterface()
    for call, certain in _calls(found):
        _add_call(call, imported, result, certain=certain)
    return InterfaceEntry(
        subscribes=result.topics["create_subscription"],
        publishes=result.topics["create_publisher"],
        parameters=result.parameters,
        qos=result.qos,
        origin="source",
    )


def _import_names(tree: ast.Module) -> dict[str, str]:
    """The full names of imports, by the names that the file uses."""
    names = {}
    for each in ast.walk(tree):
        if isinstance(each, ast.ImportFrom) and each.module and not each.level:
            for alias in each.names:
                names[alias.asname or alias.name] = f"{each.module}.{alias.name}"
        elif isinstance(each, ast.Import):
            for alias in each.names:
                names[alias.asname or alias.name.partition(".")[0]] = (
                    alias.name if alias.asname else alias.name.partition(".")[0]
                )
    return names


def _is_plain_node(found: ast.ClassDef, imported: dict[str, str]) -> bool:
    base = _full_name(found.bases[0], imported) if len(found.bases) == 1 else ""
    return base == "rclpy.node.Node" and not found.decorator_list and not found.keywords


def _full_name(node: ast.expr, imported: dict[str, str]) -> str:
    if isinstance(node, ast.Name):
        return imported.get(node.id, "")
    if isinstance(node, ast.Attribute):
        above = _full_name(node.value, imported)
        return f"{above}.{node.attr}" if above else ""
    return ""


def _leaks_self(found: ast.ClassDef) -> bool:
    """Whether `self` is passed to other code, which may then create topics of the node."""
    for each in ast.walk(found):
        if isinstance(each, ast.Call):
            given = (*each.args, *(keyword.value for keyword in each.keywords))
            if any(isinstance(value, ast.Name) and value.id == "self" for value in given):
                return True
    return False


def _calls(found: ast.ClassDef) -> Iterator[tuple[ast.Call, bool]]:
    """Each call of a method of `self`, and whether it is certainly made exactly once."""
    for method in found.body:
        made = isinstance(method, ast.FunctionDef) and method.name == "__init__"
        # Without recursion: each `elif` is one level deeper than the one before.
        waiting: list[tuple[ast.AST, bool]] = [(method, made)]
        while waiting:
            node, certain = waiting.pop()
            if node is not method:
                certain = certain and not isinstance(node, _CONDITIONAL_NODES)
                if isinstance(node, ast.Call) and _self_method_name(node):
                    yield node, certain
            waiting.extend(reversed([(each, certain) for each in ast.iter_child_nodes(node)]))


def _self_method_name(call: ast.Call) -> str:
    called = call.func
    of_self = (
        isinstance(called, ast.Attribute)
        and isinstance(called.value, ast.Name)
        and called.value.id == "self"
    )
    return called.attr if of_self and isinstance(called, ast.Attribute) else ""


def _add_call(
    call: ast.Call, imported: dict[str, str], found: _PartialInterface, *, certain: bool
) -> None:
    method = _self_method_name(call)
    if method in found.topics:
        topic = _topic(call, imported) if certain else None
        known = found.topics[method]
        if topic is None or known is None:
            found.topics[method] = None
        else:
            known[topic[0]] = topic[1]
            qos = _qos_from_depth(call, 2 if method == "create_publisher" else 3)
            if qos is not None:
                found.qos[topic[0]] = qos
    elif method == "declare_parameter" and certain:
        declared = _parameter(call)
        if declared is None or found.parameters is None:
            found.parameters = None
        else:
            found.parameters[declared[0]] = declared[1]
    elif method in {"declare_parameter", "declare_parameters"}:
        found.parameters = None


def _argument(call: ast.Call, position: int, name: str) -> ast.expr | None:
    if any(isinstance(each, ast.Starred) for each in call.args):
        return None
    if len(call.args) > position:
        return call.args[position]
    return next((each.value for each in call.keywords if each.arg == name), None)


def _topic(call: ast.Call, imported: dict[str, str]) -> tuple[str, str] | None:
    kind, name = _argument(call, 0, "msg_type"), _argument(call, 1, "topic")
    if kind is None or not isinstance(name, ast.Constant) or not isinstance(name.value, str):
        return None
    package, middle, message = (["", "", *_full_name(kind, imported).split(".")])[-3:]
    if middle != "msg" or not package:
        return None
    return name.value, f"{package}/msg/{message}"


def _qos_from_depth(call: ast.Call, position: int) -> QoS | None:
    """The profile for a QoS argument that is a number."""
    given = _argument(call, position, "qos_profile")
    depth = given.value if isinstance(given, ast.Constant) else None
    return QoS(depth=depth) if type(depth) is int and depth > 0 else None


def _parameter(call: ast.Call) -> tuple[str, ParameterInfo] | None:
    name, value = _argument(call, 0, "name"), _argument(call, 1, "value")
    if not isinstance(name, ast.Constant) or not isinstance(name.value, str):
        return None
    try:
        default = None if value is None else ast.literal_eval(value)
    except (ValueError, TypeError, SyntaxError, RecursionError, MemoryError):
        # A map with a list as key is a TypeError.
        return name.value, ParameterInfo("")
    kind: ParameterType | Literal[""] = _TYPES.get(type(default), "")
    if any(keyword.arg == "descriptor" for keyword in call.keywords) or len(call.args) > 2:
        # A descriptor may allow other types.
        return name.value, ParameterInfo("", default if kind else None)
    return name.value, ParameterInfo(kind, default if kind else None)
