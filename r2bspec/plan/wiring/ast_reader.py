"""Reading a node's topics and parameters from its Python source, without running it.

A class is supported if its only base class is `Node`, and if no other code can create topics or
parameters of the node (`r2bspec.plan.wiring.python_source`); so is a function that makes one node
of such a class, and spins. Every call of `create_publisher`, `create_subscription` and
`declare_parameter` on `self` must have literal arguments, and be a statement of the constructor
outside of loops and branches. Otherwise the publishers, subscriptions or parameters of the node are
unknown.
"""

from __future__ import annotations

import ast
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import Literal

from r2bspec.language.spec import QoS
from r2bspec.plan.wiring import python_source
from r2bspec.plan.wiring.node_interface import InterfaceEntry, ParameterInfo, ParameterType
from r2bspec.safe_io.limits import MAX_PYTHON_BYTES
from r2bspec.safe_io.safe_file import ByteBudget, read_bytes

_MAX_KEPT_BYTES = 10_000
_SIMPLE_STATEMENTS = (ast.Expr, ast.Assign, ast.AnnAssign)
"""Statements of a constructor that are executed exactly once."""

_CONDITIONAL_NODES = (
    *(ast.FunctionDef, ast.AsyncFunctionDef, ast.Lambda, ast.ClassDef),
    *(ast.IfExp, ast.BoolOp, ast.Compare),
    *(ast.ListComp, ast.SetComp, ast.DictComp, ast.GeneratorExp),
)
"""Expressions whose parts may be evaluated several times, or not at all."""

_PARAMETER_OPTIONS = frozenset(
    {"automatically_declare_parameters_from_overrides", "allow_undeclared_parameters"}
)
"""Options of `Node` with which it has parameters that it does not declare by name."""

_TYPES: dict[type, ParameterType] = {bool: "bool", int: "integer", float: "double", str: "string"}


@dataclass
class _PartialInterface:
    """The interface so far; a part becomes None with the first call that is not literal."""

    names: python_source.SourceNames
    topics: dict[str, dict[str, str] | None] = field(
        default_factory=lambda: {"create_publisher": {}, "create_subscription": {}}
    )
    parameters: dict[str, ParameterInfo] | None = field(default_factory=dict)
    qos: dict[str, QoS] = field(default_factory=dict)

    def forget(self, method: str) -> None:
        """Note that a method of `Node` may be called elsewhere."""
        if method in self.topics:
            self.topics[method] = None
        elif method.startswith("destroy_"):
            self.topics[method.replace("destroy_", "create_")] = None
        else:
            self.parameters = None

    def add_call(self, call: ast.Call, *, certain: bool) -> None:
        """Take a call of a method of `self` into account."""
        method = python_source.method_of_self(call)
        if method in self.topics:
            self._add_topic(call, method, _topic(call, self.names) if certain else None)
        elif method == "declare_parameter" and certain:
            declared = _parameter(call)
            if declared is None or self.parameters is None:
                self.parameters = None
            else:
                self.parameters[declared[0]] = declared[1]
        elif method == "__init__":
            self._add_base_constructor(call)
        elif method in python_source.PARAMETER_METHODS or method.startswith("destroy_"):
            self.forget(method)

    def _add_topic(self, call: ast.Call, method: str, topic: tuple[str, str] | None) -> None:
        known = self.topics[method]
        if topic is None or known is None or known.get(topic[0], topic[1]) != topic[1]:
            self.topics[method] = None
            return
        known[topic[0]] = topic[1]
        qos = _qos_from_depth(call, 2 if method == "create_publisher" else 3)
        if qos is not None:
            self.qos[topic[0]] = qos

    def _add_base_constructor(self, call: ast.Call) -> None:
        """Take the arguments of ``super().__init__`` into account.

        They may declare every parameter that is set, and rename topics.
        """
        for keyword in call.keywords:
            if keyword.arg == "cli_args":
                self.topics = dict.fromkeys(self.topics)
            if keyword.arg in _PARAMETER_OPTIONS and ast.unparse(keyword.value) != "False":
                self.parameters = None


def read_python_file(
    source: Path, folder: Path | None = None, budget: ByteBudget | None = None
) -> ast.Module | None:
    """The syntax tree of a Python file, or None if it cannot be read.

    Args:
        source: the file.
        folder: where the file must be; by default anywhere.
        budget: what this file and others may have together.
    """
    folders = None if folder is None else (folder,)
    try:
        content = read_bytes(source, max_bytes=MAX_PYTHON_BYTES, folders=folders, budget=budget)
        return _parsed(content) if len(content) <= _MAX_KEPT_BYTES else ast.parse(content)
    except (OSError, SyntaxError, ValueError, RecursionError, MemoryError):
        return None


@lru_cache(maxsize=8)
def _parsed(content: bytes) -> ast.Module:
    """The tree of a text that many specs name, or that an editor reads again and again."""
    return ast.parse(content)


def read_node_class(tree: ast.Module, name: str) -> InterfaceEntry | None:
    """The interface of a class of a file, or of the function that runs one; None if unknown.

    Args:
        tree: of the file.
        name: of the class, or of a function such as ``main`` (`program_class`).
    """
    names = python_source.SourceNames(tree)
    node_class = names.definition(name)
    if isinstance(node_class, ast.FunctionDef):
        node_class = python_source.program_class(node_class, names)
    if not isinstance(node_class, ast.ClassDef) or not _is_plain_node(node_class, names):
        return None
    uses = python_source.SelfReferences(tree, node_class)
    if uses.escapes:
        return None
    result = _PartialInterface(names)
    for method in uses.escaped_methods:
        result.forget(method)
    for call, certain in _calls(node_class):
        result.add_call(call, certain=certain)
    if not _passes_keywords_unchanged(node_class):
        result.topics, result.parameters = dict.fromkeys(result.topics), None
    return InterfaceEntry(
        subscribes=result.topics["create_subscription"],
        publishes=result.topics["create_publisher"],
        parameters=result.parameters,
        qos=result.qos,
        origin="source",
    )


def _is_plain_node(found: ast.ClassDef, names: python_source.SourceNames) -> bool:
    base = names.full_name(found.bases[0]) if len(found.bases) == 1 else ""
    return base == "rclpy.node.Node" and not found.decorator_list and not found.keywords


def _passes_keywords_unchanged(found: ast.ClassDef) -> bool:
    """Whether arguments with ``**`` are only those of the caller, and are not changed.

    Others may have any option of `Node`.
    """
    for method in found.body:
        if not isinstance(method, ast.FunctionDef) or method.name != "__init__":
            continue
        own = method.args.kwarg.arg if method.args.kwarg else ""
        nodes = list(ast.walk(method))
        if sum(python_source.is_name(node, own) for node in nodes) != sum(
            _harmless_uses(node, own) for node in nodes
        ):
            return False
        base_calls = (
            node
            for node in nodes
            if isinstance(node, ast.Call) and python_source.method_of_self(node) == "__init__"
        )
        keywords = (keyword for call in base_calls for keyword in call.keywords)
        if any(
            keyword.arg is None and not python_source.is_name(keyword.value, own)
            for keyword in keywords
        ):
            return False
    return True


def _harmless_uses(node: ast.AST, name: str) -> int:
    """How often a node directly uses a map without changing it or giving it another name."""
    match node:
        case ast.keyword(arg=None, value=value) | ast.If(test=value):
            return python_source.is_name(value, name)
        case (
            ast.Call(func=ast.Attribute(value=value, attr="get" | "pop"))
            | ast.Subscript(value=value, ctx=ast.Load())
        ):
            return python_source.is_name(value, name)
        case ast.Compare():
            return sum(python_source.is_name(part, name) for part in (node.left, *node.comparators))
    return 0


def _calls(found: ast.ClassDef) -> Iterator[tuple[ast.Call, bool]]:
    """Each call of a method of `self`, and whether it is certainly made exactly once."""
    for method in found.body:
        if isinstance(method, ast.FunctionDef) and method.name == "__init__":
            returned = False
            for statement in method.body:
                simple = isinstance(statement, _SIMPLE_STATEMENTS)
                yield from _calls_below(statement, certain=simple and not returned)
                ends = (
                    isinstance(node, ast.Return) for node in python_source.own_nodes([statement])
                )
                returned = returned or any(ends)
        else:
            yield from _calls_below(method, certain=False)


def _calls_below(top: ast.AST, *, certain: bool) -> Iterator[tuple[ast.Call, bool]]:
    # Without recursion: each `elif` is one level deeper than the one before.
    waiting: list[tuple[ast.AST, bool]] = [(top, certain)]
    while waiting:
        node, certain = waiting.pop()
        certain = certain and not isinstance(node, _CONDITIONAL_NODES)
        if isinstance(node, ast.Call) and python_source.method_of_self(node):
            yield node, certain
        waiting.extend(reversed([(child, certain) for child in ast.iter_child_nodes(node)]))


def _argument(call: ast.Call, position: int, name: str) -> ast.expr | None:
    if any(isinstance(argument, ast.Starred) for argument in call.args):
        return None
    if len(call.args) > position:
        return call.args[position]
    return next((keyword.value for keyword in call.keywords if keyword.arg == name), None)


def _topic(call: ast.Call, names: python_source.SourceNames) -> tuple[str, str] | None:
    kind, name = _argument(call, 0, "msg_type"), _argument(call, 1, "topic")
    if kind is None or not isinstance(name, ast.Constant) or not isinstance(name.value, str):
        return None
    package, middle, message = (["", "", *names.full_name(kind).split(".")])[-3:]
    if middle != "msg" or not package:
        return None
    return name.value, f"{package}/msg/{message}"


def _qos_from_depth(call: ast.Call, position: int) -> QoS | None:
    """The profile for a QoS argument that is a number."""
    if any(keyword.arg == "qos_overriding_options" for keyword in call.keywords):
        return None
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
