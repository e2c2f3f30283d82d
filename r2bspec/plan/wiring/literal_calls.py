"""What the calls in the source of a node say by their text: topics, types, parameters, timers.

A topic is a literal, a name that is bound to one once, or the value of a parameter with a literal
name, which is written ``$(parameter NAME)`` as in an interface file.
"""

from __future__ import annotations

import ast
from collections import Counter
from collections.abc import Iterator
from typing import Literal

from r2bspec.language.spec import QoS
from r2bspec.plan.wiring.node_interface import ParameterInfo, ParameterType
from r2bspec.plan.wiring.python_source import SourceNames, nodes_below
from r2bspec.plan.wiring.self_references import PUBLISHER_METHODS, is_name, is_self, method_of_self

_TYPES: dict[type, ParameterType] = {bool: "bool", int: "integer", float: "double", str: "string"}

_REPEATED = (
    *(ast.For, ast.AsyncFor, ast.While, ast.ListComp, ast.SetComp, ast.DictComp),
    *(ast.GeneratorExp, ast.FunctionDef, ast.AsyncFunctionDef, ast.Lambda),
)
"""What may evaluate the expressions in it several times, or later."""


def argument(call: ast.Call, position: int, name: str) -> ast.expr | None:
    """An argument by its position or its name; None if it is not given, or by ``*``."""
    if any(isinstance(argument, ast.Starred) for argument in call.args):
        return None
    if len(call.args) > position:
        return call.args[position]
    return next((keyword.value for keyword in call.keywords if keyword.arg == name), None)


def interface_type(
    given: ast.expr | None, names: SourceNames, kind: Literal["msg", "srv", "action"] = "msg"
) -> str:
    """The type of this kind that a class stands for; empty if the text does not say it."""
    if given is None:
        return ""
    package, middle, name = (["", "", *names.full_name(given).split(".")])[-3:]
    return f"{package}/{kind}/{name}" if middle == kind and package else ""


def qos_profile(call: ast.Call, position: int, names: SourceNames) -> QoS | None:
    """The profile for a QoS argument that is a number, or the profile of sensor data."""
    if any(keyword.arg == "qos_overriding_options" for keyword in call.keywords):
        return None
    given = argument(call, position, "qos_profile")
    if given is not None and names.full_name(given) == "rclpy.qos.qos_profile_sensor_data":
        return QoS.from_word("sensor_data")
    depth = given.value if isinstance(given, ast.Constant) else None
    return QoS(depth=depth) if type(depth) is int and depth > 0 else None


def declared_parameters(call: ast.Call, method: str) -> list[tuple[str, ParameterInfo]] | None:
    """The parameters of ``declare_parameter(name, value)`` or ``declare_parameters("", [...])``.

    None if their names are no literals.
    """
    if method == "declare_parameter":
        described = any(each.arg == "descriptor" for each in call.keywords) or len(call.args) > 2
        found = [_declared(argument(call, 0, "name"), argument(call, 1, "value"), described)]
    else:
        match call:
            case ast.Call(
                args=[ast.Constant(value=""), ast.List(elts=items) | ast.Tuple(elts=items)],
                keywords=[],
            ):
                found = [
                    _declared(item.elts[0], item.elts[1], len(item.elts) > 2)
                    if isinstance(item, ast.Tuple) and len(item.elts) > 1
                    else None
                    for item in items
                ]
            case _:
                return None
    known = [each for each in found if each is not None]
    return known if len(known) == len(found) else None


def _declared(
    name: ast.expr | None, value: ast.expr | None, has_descriptor: bool
) -> tuple[str, ParameterInfo] | None:
    if not isinstance(name, ast.Constant) or not isinstance(name.value, str):
        return None
    try:
        default = None if value is None else ast.literal_eval(value)
    except (ValueError, TypeError, SyntaxError, RecursionError, MemoryError):
        # A map with a list as key is a TypeError.
        return name.value, ParameterInfo("")
    kind: ParameterType | Literal[""] = _TYPES.get(type(default), "")
    # A descriptor may allow other types.
    return name.value, ParameterInfo("" if has_descriptor else kind, default if kind else None)


def timer_outputs(found: ast.ClassDef, topics: TopicNames) -> Iterator[tuple[str, str | None]]:
    """The topics that a class publishes by a timer alone, and its period by `TopicNames.number`.

    That is at a pace of its own, at most once each time: the class stores the publisher and calls
    its ``publish`` in one place, in a method that nothing but one timer calls, in no loop there.
    """
    mentioned = attributes_of_self(found)
    methods = {part.name: part for part in found.body if isinstance(part, ast.FunctionDef)}
    for method in methods.values():
        for call in nodes_below(method):
            if not isinstance(call, ast.Call) or method_of_self(call) != "create_timer":
                continue
            callback = _attribute(argument(call, 1, "callback"))
            if callback not in methods or mentioned[callback] != 1:
                continue
            period_s = topics.number(argument(call, 0, "timer_period_sec"), method)
            for publisher in _published_once(methods[callback]):
                # Where it is stored, and here.
                made = topics.stored(publisher) if mentioned[publisher] == 2 else None
                if isinstance(made, ast.Call) and method_of_self(made) in PUBLISHER_METHODS:
                    topic = topics.resolve(argument(made, 1, "topic"), method)
                    if topic is not None:
                        yield topic, period_s


def attributes_of_self(found: ast.ClassDef) -> Counter[str]:
    """How often a class mentions each attribute of its node."""
    return Counter(name for node in nodes_below(found) if (name := _attribute(node)))


def _attribute(node: ast.AST | None) -> str:
    return node.attr if isinstance(node, ast.Attribute) and is_self(node.value) else ""


def _published_once(method: ast.FunctionDef) -> Iterator[str]:
    """The attributes of `self` on which a method calls ``publish`` at most once."""
    waiting: list[ast.AST] = [*method.body]
    while waiting:
        node = waiting.pop()
        match node:
            case ast.Call(func=ast.Attribute(value=ast.Attribute() as target, attr="publish")):
                if name := _attribute(target):
                    yield name
        if not isinstance(node, _REPEATED):
            waiting.extend(ast.iter_child_nodes(node))


_PARAMETER_VALUES = frozenset({"value", "string_value"})
_NUMBER_VALUES = frozenset({"value", "double_value", "integer_value"})
_PARAMETER_SOURCES = frozenset({"declare_parameter", "get_parameter"})
_MAX_STEPS = 10


class TopicNames:
    """Resolves the expressions of one class.

    Args:
        found: the class.
        names: the names of its file.
    """

    def __init__(self, found: ast.ClassDef, names: SourceNames) -> None:
        self._names = names
        self._locals = {
            id(method): _single_values(method, attributes=False)
            for method in found.body
            if isinstance(method, ast.FunctionDef)
        }
        self._attributes = _single_values(found, attributes=True)

    def resolve(self, node: ast.expr | None, method: ast.AST) -> str | None:
        """The topic that an expression in a method means; None if the text does not say it."""
        match self._followed(node, method):
            case ast.Constant(value=str(text)):
                return text
            case ast.Attribute(value=inner, attr=name) if name in _PARAMETER_VALUES:
                return self._parameter(inner, method)
        return None

    def number(self, node: ast.expr | None, method: ast.AST) -> str | None:
        """The number that an expression in a method means, or the quotient of two; as text.

        The value of a parameter is ``$(parameter NAME)``.
        """
        match self._followed(node, method):
            case ast.BinOp(left=left, op=ast.Div(), right=right):
                sides = [self._simple_number(side, method) for side in (left, right)]
                return " / ".join(side for side in sides if side) if all(sides) else None
            case found:
                return self._simple_number(found, method)

    def _simple_number(self, node: ast.expr | None, method: ast.AST) -> str | None:
        match self._followed(node, method):
            case ast.Constant(value=int() | float() as number):
                return f"{number}"
            case ast.Attribute(value=inner, attr=name) if name in _NUMBER_VALUES:
                return self._parameter(inner, method)
        return None

    def stored(self, attribute: str) -> ast.expr | None:
        """The only value that an attribute of `self` gets; None if there are others."""
        return self._attributes.get(attribute)

    def _followed(self, node: ast.expr | None, method: ast.AST) -> ast.expr | None:
        """What a name or an attribute is bound to, once and for all; None if that is not known."""
        for _ in range(_MAX_STEPS):
            match node:
                case ast.Name(id=name):
                    known = self._locals.get(id(method), {})
                    node = known[name] if name in known else self._names.constant(name)
                case ast.Attribute(attr=name) if is_name(node.value, "self"):
                    node = self.stored(name)
                case _:
                    return node
        return None

    def _parameter(self, node: ast.expr | None, method: ast.AST) -> str | None:
        """The reference to a parameter that an expression is, or whose value it is."""
        for _ in range(_MAX_STEPS):
            match node:
                case ast.Name(id=name):
                    node = self._locals.get(id(method), {}).get(name)
                case ast.Call(func=ast.Attribute(value=inner, attr="get_parameter_value")):
                    node = inner
                case ast.Call(args=[ast.Constant(value=str(name)), *_]) if (
                    method_of_self(node) in _PARAMETER_SOURCES
                ):
                    return f"$(parameter {name})"
                case _:
                    return None
        return None


def _single_values(top: ast.AST, *, attributes: bool) -> dict[str, ast.expr | None]:
    """The only value that each variable gets, or attribute of `self`; None if there are others.

    What is bound by a loop, `with` or the like has no value here.
    """
    assigned: dict[int, ast.expr] = {}
    values: dict[str, ast.expr | None] = {}
    for node in nodes_below(top):  # a statement before its targets
        match node:
            case (
                ast.Assign(targets=[target], value=value)
                | ast.AnnAssign(target=target, value=ast.expr() as value)
            ):
                assigned[id(target)] = value
            case _:
                if name := _bound(node, attributes=attributes):
                    values[name] = None if name in values else assigned.get(id(node))
    return values


def _bound(node: ast.AST, *, attributes: bool) -> str:
    """The variable, or the attribute of `self`, that a node binds; empty for any other node."""
    match node:
        case ast.arg(arg=name) | ast.Name(id=name, ctx=ast.Store()) if not attributes:
            return name
        case ast.Attribute(attr=name, ctx=ast.Store()) if attributes and is_self(node.value):
            return name
    return ""
