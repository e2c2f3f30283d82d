"""Whether other code than its class can create topics or parameters of a node.

What a class says of its node is complete only if `self`, and the methods of `Node` that create
publishers, subscriptions and parameters, are used in no other way than in direct calls, such as
``self.create_publisher(...)``. As soon as one of them is passed, stored or renamed, any code may
use it, and the text of the class no longer determines the interface of the node.
"""

from __future__ import annotations

import ast
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field

TOPIC_METHODS = frozenset({"create_publisher", "create_subscription"})
PARAMETER_METHODS = frozenset({"declare_parameter", "declare_parameters", "undeclare_parameter"})
_CREATING = TOPIC_METHODS | PARAMETER_METHODS | {"destroy_publisher", "destroy_subscription"}

_HARMLESS_ATTRIBUTES = frozenset({"default_callback_group", "context", "handle"})
"""Attributes of `Node` that may be passed to other code."""

_METHOD_DECORATORS = frozenset({"staticmethod", "classmethod", "property"})
_NAMES_WITH_ACCESS = frozenset({"locals", "globals", "vars", "eval", "exec", "__class__"})
"""Names of functions that find `self` by other means than its name."""

_SPECIAL_METHODS = frozenset({"__init__", "__del__", "__repr__", "__str__"})
"""Special methods that do not change what an attribute or a constructor is."""


@dataclass
class SelfReferences:
    """How a class uses `self`.

    Attributes:
        escapes: whether other code may reach the node.
        escaped_methods: methods of `Node` that are used other than in direct calls.
    """

    escapes: bool = False
    escaped_methods: set[str] = field(default_factory=set)


def self_references(tree: ast.Module, found: ast.ClassDef) -> SelfReferences:
    """How a class uses `self`, and whether the rest of its file changes the class."""
    result = SelfReferences()
    if _is_changed_elsewhere(tree, found) or not _has_plain_body(found):
        result.escapes = True
        return result
    scan = _Scan(found, result)
    for method in found.body:
        scan.visit(method)
    return result


def method_of_self(call: ast.Call) -> str:
    """The method of ``self.method(...)`` or ``super().method(...)``; empty for any other call."""
    called = call.func
    return called.attr if isinstance(called, ast.Attribute) and is_self(called.value) else ""


def is_self(node: ast.AST) -> bool:
    """Whether an expression is `self`, or a call of `super`."""
    if isinstance(node, ast.Name):
        return node.id == "self"
    return isinstance(node, ast.Call) and _is_name(node.func, "super") and not node.keywords


def _is_name(node: ast.AST, name: str) -> bool:
    return isinstance(node, ast.Name) and node.id == name


def _is_changed_elsewhere(tree: ast.Module, found: ast.ClassDef) -> bool:
    """Whether code of the file may replace attributes of the class, or of `Node`."""
    inside = {id(each) for each in ast.walk(found)}
    for node in ast.walk(tree):
        match node:
            case ast.Attribute(attr=name, ctx=ast.Store() | ast.Del()) if name in _CREATING:
                return True
            case ast.Attribute(value=ast.Name(id=name), ctx=ast.Store() | ast.Del()) if (
                name == found.name
            ):
                return True
            case ast.Constant(value=str(text)) if text in _CREATING:
                return True
            case ast.Call() if id(node) not in inside and _passes(node, found.name):
                return True
            case ast.ClassDef() if node is not found and found.name in {
                each.id for each in node.decorator_list if isinstance(each, ast.Name)
            }:
                return True
    return False


def _passes(call: ast.Call, name: str) -> bool:
    """Whether a call has this name among its arguments."""
    arguments = (*call.args, *(each.value for each in call.keywords))
    return any(_is_name(each, name) for argument in arguments for each in ast.walk(argument)) and (
        not _is_constructor_argument(arguments, name)
    )


def _is_constructor_argument(arguments: Iterable[ast.expr], name: str) -> bool:
    """Whether the name occurs in arguments only as what is called, as in ``spin(Detector())``."""
    uses = [each for argument in arguments for each in ast.walk(argument) if _is_name(each, name)]
    called = [
        each.func
        for argument in arguments
        for each in ast.walk(argument)
        if isinstance(each, ast.Call) and _is_name(each.func, name)
    ]
    return len(uses) == len(called)


def _has_plain_body(found: ast.ClassDef) -> bool:
    """Whether a class consists of plain methods and values, and overrides nothing that creates."""
    for each in found.body:
        match each:
            case ast.FunctionDef() | ast.AsyncFunctionDef():
                if not _is_plain_method(each):
                    return False
            case ast.Assign() | ast.AnnAssign():
                names = {one.id for one in ast.walk(each) if isinstance(one, ast.Name)}
                if names & _CREATING:
                    return False
            case ast.Pass() | ast.Expr(value=ast.Constant()):
                pass
            case _:
                return False
    return True


def _is_plain_method(method: ast.FunctionDef | ast.AsyncFunctionDef) -> bool:
    special = method.name.startswith("__") and method.name not in _SPECIAL_METHODS
    if special or method.name in _CREATING:
        return False
    decorators = [each.id if isinstance(each, ast.Name) else "" for each in method.decorator_list]
    if not _METHOD_DECORATORS.issuperset(decorators):
        return False
    if {"staticmethod", "classmethod"} & set(decorators):
        return True
    parameters = [*method.args.posonlyargs, *method.args.args]
    return bool(parameters) and parameters[0].arg == "self"


class _Scan:
    """A walk over the methods of a class that looks at every use of `self`."""

    def __init__(self, found: ast.ClassDef, result: SelfReferences) -> None:
        self._class = found.name
        self._result = result
        functions = (ast.FunctionDef, ast.AsyncFunctionDef)
        self._methods = {each.name for each in found.body if isinstance(each, functions)}
        self._data = {
            each.attr
            for each in ast.walk(found)
            if isinstance(each, ast.Attribute)
            and is_self(each.value)
            and isinstance(each.ctx, ast.Store)
        } | {
            each.id
            for statement in found.body
            if isinstance(statement, ast.Assign | ast.AnnAssign)
            for each in ast.walk(statement)
            if isinstance(each, ast.Name) and isinstance(each.ctx, ast.Store)
        }

    def visit(self, top: ast.AST) -> None:
        """Look at everything below a node; without recursion, as each `elif` is one level deep."""
        waiting: list[ast.AST] = [top]
        while waiting:
            node = waiting.pop()
            match node:
                case ast.Attribute() if is_self(node.value):
                    self._attribute(node, called=False, harmless_target=False)
                case ast.Call() if isinstance(node.func, ast.Attribute) and is_self(
                    node.func.value
                ):
                    self._attribute(node.func, called=True, harmless_target=False)
                    waiting.extend(self._arguments(node))
                case ast.Name() if node.id in {"self", "super"} | _NAMES_WITH_ACCESS:
                    self._result.escapes = True
                case _:
                    waiting.extend(ast.iter_child_nodes(node))

    def _arguments(self, call: ast.Call) -> Iterator[ast.AST]:
        """The arguments of a method of self, other than methods that `Node` takes as callbacks."""
        of_node = method_of_self(call) not in self._methods | self._data
        for argument in (*call.args, *(each.value for each in call.keywords)):
            if of_node and isinstance(argument, ast.Attribute) and is_self(argument.value):
                self._attribute(argument, called=False, harmless_target=True)
            else:
                yield argument

    def _attribute(self, node: ast.Attribute, *, called: bool, harmless_target: bool) -> None:
        name = node.attr
        if isinstance(node.value, ast.Call) and not self._is_plain_super(node.value):
            self._result.escapes = True
        elif name.startswith("__"):
            self._result.escapes |= not (
                called and name == "__init__" and isinstance(node.value, ast.Call)
            )
        elif name in _CREATING:
            if not called:
                self._result.escaped_methods.add(name)
        elif name in self._methods:
            self._result.escapes |= not (called or harmless_target) or name in self._data
        elif name in self._data or name in _HARMLESS_ATTRIBUTES:
            pass
        else:
            # A method of Node: harmless if public and called.
            self._result.escapes |= not called or name.startswith("_")

    def _is_plain_super(self, call: ast.Call) -> bool:
        """``super()``, or ``super(Class, self)``."""
        match call.args:
            case [] | [ast.Name(id=self._class), ast.Name(id="self")]:
                return True
        return False
