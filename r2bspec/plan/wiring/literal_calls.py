"""The literal arguments of calls that make topics or timers, or declare parameters."""

from __future__ import annotations

import ast
from collections import Counter
from collections.abc import Iterator
from typing import Literal

from r2bspec.language.spec import QoS
from r2bspec.plan.wiring import self_references
from r2bspec.plan.wiring.node_interface import ParameterInfo, ParameterType
from r2bspec.plan.wiring.python_source import SourceNames
from r2bspec.plan.wiring.topic_names import TopicNames

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


def declared_parameter(call: ast.Call) -> tuple[str, ParameterInfo] | None:
    """The parameter of ``declare_parameter(name, value)``; None if its name is no literal."""
    has_descriptor = (
        any(keyword.arg == "descriptor" for keyword in call.keywords) or len(call.args) > 2
    )
    name, value = argument(call, 0, "name"), argument(call, 1, "value")
    return _declared(name, value, has_descriptor=has_descriptor)


def declared_parameters(call: ast.Call) -> list[tuple[str, ParameterInfo]] | None:
    """The parameters of ``declare_parameters("", [(name, value), ...])``."""
    match call:
        case ast.Call(
            args=[ast.Constant(value=""), ast.List(elts=items) | ast.Tuple(elts=items)], keywords=[]
        ):
            found = [
                _declared(item.elts[0], item.elts[1], has_descriptor=len(item.elts) > 2)
                if isinstance(item, ast.Tuple) and len(item.elts) > 1
                else None
                for item in items
            ]
            known = [each for each in found if each is not None]
            return known if len(known) == len(found) else None
    return None


def _declared(
    name: ast.expr | None, value: ast.expr | None, *, has_descriptor: bool
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
        for call in ast.walk(method):
            if not isinstance(call, ast.Call) or (
                self_references.method_of_self(call) != "create_timer"
            ):
                continue
            callback = _attribute(argument(call, 1, "callback"))
            if callback not in methods or mentioned[callback] != 1:
                continue
            period_s = topics.number(argument(call, 0, "timer_period_sec"), method)
            for publisher in _published_once(methods[callback]):
                # Where it is stored, and here.
                made = topics.stored(publisher) if mentioned[publisher] == 2 else None
                if isinstance(made, ast.Call) and (
                    self_references.method_of_self(made) in self_references.PUBLISHER_METHODS
                ):
                    topic = topics.resolve(argument(made, 1, "topic"), method)
                    if topic is not None:
                        yield topic, period_s


def attributes_of_self(found: ast.ClassDef) -> Counter[str]:
    """How often a class mentions each attribute of its node."""
    return Counter(name for node in ast.walk(found) if (name := _attribute(node)))


def _attribute(node: ast.AST | None) -> str:
    is_own = isinstance(node, ast.Attribute) and self_references.is_self(node.value)
    return node.attr if is_own and isinstance(node, ast.Attribute) else ""


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
