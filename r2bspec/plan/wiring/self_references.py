"""How a class of a node uses `self`: whether the text of the class says all of its topics.

What a class says of its node is complete only if `self`, and the methods of `Node` that create
publishers, subscriptions and parameters, are used in no other way than in direct calls, such as
``self.create_publisher(...)``, or are passed to a class of which is known what it makes. As soon as
one of them is passed to other code, stored or renamed, that code may make topics, too.
"""

from __future__ import annotations

import ast
from collections.abc import Iterator, Mapping
from typing import Final

import msgspec

from r2bspec.plan.wiring.python_source import SourceNames, nodes_below

PUBLISHER_METHODS = frozenset({"create_publisher", "create_lifecycle_publisher"})
PARAMETER_METHODS = frozenset({"declare_parameter", "declare_parameters", "undeclare_parameter"})
_CREATING = (
    PARAMETER_METHODS
    | PUBLISHER_METHODS
    | {"create_subscription", "destroy_publisher", "destroy_subscription"}
)

_HARMLESS_ATTRIBUTES = frozenset({"default_callback_group", "context", "handle"})
"""Attributes of `Node` that may be passed to other code."""

_METHOD_DECORATORS = frozenset({"staticmethod", "classmethod", "property"})
_NAMES_WITH_ACCESS = frozenset({"locals", "globals", "vars", "eval", "exec", "__class__"})
"""Names of functions that find `self` by other means than its name."""

_SPECIAL_METHODS = frozenset({"__init__", "__del__", "__repr__", "__str__"})
"""Special methods that do not change what an attribute or a constructor is."""

_TRANSFORMS: Final = "tf2_msgs/msg/TFMessage"


class NodeHelper(msgspec.Struct, frozen=True):
    """A class whose constructor gets the node.

    Attributes:
        node: the position of the node among the arguments; it may also be called ``node``.
        publishes: the types of the topics that it publishes for the node, by their names.
        subscribes: likewise.
        makes_subscription: whether its arguments after the node are those of a subscription.
        names_action: whether its third argument is the name of an action; the type comes first.
        answers: whether it is the server of this action.
    """

    node: int = 0
    publishes: Mapping[str, str] = msgspec.field(default_factory=dict)
    subscribes: Mapping[str, str] = msgspec.field(default_factory=dict)
    makes_subscription: bool = False
    names_action: bool = False
    answers: bool = False


_NODE_HELPERS: Final[Mapping[str, NodeHelper]] = {
    "message_filters.Subscriber": NodeHelper(makes_subscription=True),
    "rclpy.ActionClient": NodeHelper(names_action=True),
    "rclpy.ActionServer": NodeHelper(names_action=True, answers=True),
    "tf2_ros.Buffer": NodeHelper(1),
    "tf2_ros.StaticTransformBroadcaster": NodeHelper(publishes={"/tf_static": _TRANSFORMS}),
    "tf2_ros.TransformBroadcaster": NodeHelper(publishes={"/tf": _TRANSFORMS}),
    "tf2_ros.TransformListener": NodeHelper(
        1, subscribes={"/tf": _TRANSFORMS, "/tf_static": _TRANSFORMS}
    ),
}
"""Helpers by their packages and names; which module of the package has them makes no difference."""

CALLBACK_TAKERS: Final = frozenset({"functools.partial", "threading.Thread", "threading.Timer"})
"""Functions that get a method of a node only to call it."""

CALLBACK_METHODS: Final = frozenset({"add_done_callback", "registerCallback"})
"""Methods of other objects that do."""

METHOD = (ast.FunctionDef, ast.AsyncFunctionDef)


def method_of_self(call: ast.Call) -> str:
    """The method of ``self.method(...)`` or ``super().method(...)``; empty for any other call."""
    called = call.func
    return called.attr if isinstance(called, ast.Attribute) and is_self(called.value) else ""


def is_self(node: ast.AST) -> bool:
    """Whether an expression is `self`, or a call of `super`."""
    if isinstance(node, ast.Name):
        return node.id == "self"
    return isinstance(node, ast.Call) and is_name(node.func, "super") and not node.keywords


def is_name(node: ast.AST, name: str) -> bool:
    """Whether an expression is a name, and this one."""
    return isinstance(node, ast.Name) and node.id == name


def helper_of(call: ast.Call, names: SourceNames) -> NodeHelper | None:
    """What a call makes that passes the node to a class of which that is known."""
    package, _, inside = names.full_name(call.func).partition(".")
    helper = _NODE_HELPERS.get(f"{package}.{inside.rpartition('.')[2]}")
    if helper is None:
        return None
    given = next((keyword.value for keyword in call.keywords if keyword.arg == "node"), None)
    if given is None and len(call.args) > helper.node:
        given = call.args[helper.node]
    return helper if given is not None and is_name(given, "self") else None


def replaces_methods(tree: ast.Module, found: ast.ClassDef) -> bool:
    """Whether the methods that create topics may be others than those of `Node`."""
    for part in found.body:
        if isinstance(part, METHOD) and part.name in _CREATING:
            return True
        if isinstance(part, ast.Assign | ast.AnnAssign) and any(
            isinstance(node, ast.Name) and node.id in _CREATING for node in ast.walk(part)
        ):
            return True
    for node in nodes_below(tree):
        match node:
            case ast.Attribute(attr=name, ctx=ast.Store() | ast.Del()) if name in _CREATING:
                return True
            case ast.Constant(value=str(text)) if text in _CREATING:
                return True
    return False


def _changing_line(tree: ast.Module, found: ast.ClassDef) -> int:
    """A line of the file that may replace attributes of the class; 0 if there is none."""
    inside = {id(node) for node in nodes_below(found)}
    for node in nodes_below(tree):
        match node:
            case ast.Attribute(value=ast.Name(id=name), ctx=ast.Store() | ast.Del()) if (
                name == found.name
            ):
                return node.lineno
            case ast.Call() if id(node) not in inside and _passes(node, found.name):
                return node.lineno
            case ast.ClassDef() if node is not found and found.name in {
                name.id for name in node.decorator_list if isinstance(name, ast.Name)
            }:
                return node.lineno
    return 0


def _passes(call: ast.Call, name: str) -> bool:
    """Whether a call has a name in its arguments, other than as what is called: ``spin(N())``."""
    arguments = (*call.args, *(keyword.value for keyword in call.keywords))
    below = [node for argument in arguments for node in ast.walk(argument)]
    called = sum(isinstance(node, ast.Call) and is_name(node.func, name) for node in below)
    return sum(is_name(node, name) for node in below) != called


def _unusual_line(found: ast.ClassDef) -> int:
    """The line of a part of a class that is no plain method and no value; 0 if there is none."""
    for part in found.body:
        match part:
            case ast.FunctionDef() | ast.AsyncFunctionDef():
                if not _is_plain_method(part):
                    return part.lineno
            case ast.Assign() | ast.AnnAssign() | ast.Pass() | ast.Expr(value=ast.Constant()):
                pass
            case _:
                return part.lineno
    return 0


def _is_plain_method(method: ast.FunctionDef | ast.AsyncFunctionDef) -> bool:
    if method.name.startswith("__") and method.name not in _SPECIAL_METHODS:
        return False
    decorators = [name.id if isinstance(name, ast.Name) else "" for name in method.decorator_list]
    if not _METHOD_DECORATORS.issuperset(decorators):
        return False
    if {"staticmethod", "classmethod"} & set(decorators):
        return True
    parameters = [*method.args.posonlyargs, *method.args.args]
    return bool(parameters) and parameters[0].arg == "self"


class SelfReferences:
    """How a class uses `self`: a walk over its methods looks at every use.

    Attributes:
        escape: why other code may reach the node, or change its class; empty if none may.
        escaped_methods: methods of `Node` that are used other than in direct calls, each with why.
    """

    def __init__(self, tree: ast.Module, found: ast.ClassDef, names: SourceNames) -> None:
        self.escape = ""
        self.escaped_methods: dict[str, str] = {}
        self._names = names
        self._class = found.name
        if line := _changing_line(tree, found):
            self._escapes(line, f"may change {found.name}")
        elif line := _unusual_line(found):
            self._escapes(line, f"is not a plain method of {found.name}")
        self._methods = {part.name for part in found.body if isinstance(part, METHOD)}
        self._data = {
            node.attr
            for node in nodes_below(found)
            if isinstance(node, ast.Attribute)
            and is_self(node.value)
            and isinstance(node.ctx, ast.Store)
        } | {
            node.id
            for statement in found.body
            if isinstance(statement, ast.Assign | ast.AnnAssign)
            for node in ast.walk(statement)
            if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store)
        }
        for part in found.body:
            if not self.escape:
                self._visit(part)

    def _escapes(self, line: int, how: str) -> None:
        self.escape = self.escape or f"line {line} {how}"

    def _visit(self, top: ast.AST) -> None:
        """Look at everything below a node; without recursion, as each `elif` is one level deep."""
        waiting: list[ast.AST] = [top]
        while waiting:
            node = waiting.pop()
            match node:
                case ast.Attribute() if is_self(node.value):
                    self._attribute(node, called=False, harmless_target=False)
                case ast.Call():
                    waiting.extend(self._called(node))
                case ast.Name() if node.id in {"self", "super"} | _NAMES_WITH_ACCESS:
                    self._escapes(node.lineno, "gives the node to other code")
                case _:
                    waiting.extend(ast.iter_child_nodes(node))

    def _called(self, call: ast.Call) -> Iterator[ast.AST]:
        """What is left to be looked at of a call."""
        called = call.func
        arguments = [*call.args, *(keyword.value for keyword in call.keywords)]
        callbacks = helper_of(call, self._names) is not None
        if callbacks:
            arguments = [each for each in arguments if not is_name(each, "self")]
        elif isinstance(called, ast.Attribute) and is_self(called.value):
            self._attribute(called, called=True, harmless_target=False)
            callbacks = called.attr not in self._methods | self._data
        else:
            callbacks = self._names.full_name(called) in CALLBACK_TAKERS or (
                isinstance(called, ast.Attribute) and called.attr in CALLBACK_METHODS
            )
            yield called
        for argument in arguments:
            if callbacks and isinstance(argument, ast.Attribute) and is_self(argument.value):
                self._attribute(argument, called=False, harmless_target=True)
            elif isinstance(argument, ast.Name) and argument.id == "self":
                name = ast.unparse(called)
                self._escapes(call.lineno, f"passes the node to {name}()")
            else:
                yield argument

    def _attribute(self, node: ast.Attribute, *, called: bool, harmless_target: bool) -> None:
        name = node.attr
        escapes = False
        if isinstance(node.value, ast.Call) and not self._is_plain_super(node.value):
            escapes = True
        elif name.startswith("__"):
            escapes = not (called and name == "__init__" and isinstance(node.value, ast.Call))
        elif name in _CREATING:
            if not called:
                why = f"line {node.lineno} uses {name} other than by calling it"
                self.escaped_methods.setdefault(name, why)
        elif name in self._methods:
            escapes = not (called or harmless_target) or name in self._data
        elif name not in self._data | _HARMLESS_ATTRIBUTES:
            # A method of Node: harmless if public and called.
            escapes = not called or name.startswith("_")
        if escapes:
            self._escapes(node.lineno, f"gives {name} of the node to other code")

    def _is_plain_super(self, call: ast.Call) -> bool:
        """``super()``, or ``super(Class, self)``."""
        match call.args:
            case [] | [ast.Name(id=self._class), ast.Name(id="self")]:
                return True
        return False
