"""Reading a node's topics, services and parameters from its Python source, without running it.

Every call of `create_publisher`, `create_subscription`, `create_service` and `declare_parameter` on
`self` counts, in the class and in the base classes that its package defines. A class whose calls
have literal arguments is complete: a topic is a literal, a name that is bound to a literal once, or
the value of a parameter with a literal name. Otherwise, and if the node is passed to unknown code,
the interface says why there may be more. A function has the interface of the only node class that
it instantiates, or of the only node that it creates without a class: of what it, the functions
inside of it, and the functions that get the node from it create.
"""

from __future__ import annotations

import ast
from collections.abc import Iterator, Mapping
from functools import lru_cache
from pathlib import Path
from typing import Final, Literal

import msgspec

from r2bspec.language.spec import QoS
from r2bspec.plan.wiring import python_files
from r2bspec.plan.wiring.node_interface import InterfaceEntry, ParameterInfo, ParameterType
from r2bspec.plan.wiring.python_source import SourceNames, own_nodes, single_values
from r2bspec.plan.wiring.source_qos import Scope, read_profile
from r2bspec.safe_io.limits import MAX_BASE_CLASSES

_NODES: Final = frozenset({"rclpy.Node", "rclpy.node.Node"})
_LIFECYCLE_NODES: Final = frozenset(
    f"rclpy.lifecycle.{name}" for name in ("LifecycleNode", "Node", "node.LifecycleNode")
)
_CREATED: Final = _NODES | _LIFECYCLE_NODES | {"rclpy.create_node"}
"""What makes a node without a class of its own."""
_USERS: Final = frozenset({"add_node", "remove_node"})
"""Methods of executors that get a node, and create nothing of it."""
_PUBLISHER_METHODS: Final = frozenset({"create_publisher", "create_lifecycle_publisher"})
_PARAMETER_OPTIONS: Final = frozenset(
    {"automatically_declare_parameters_from_overrides", "allow_undeclared_parameters"}
)
"""Options of `Node` with which it has parameters that it does not declare by name."""
_PARAMETER_SOURCES: Final = frozenset({"declare_parameter", "get_parameter"})
_PARAMETER_VALUES: Final = frozenset({"value", "string_value"})
_TYPES: dict[type, ParameterType] = {bool: "bool", int: "integer", float: "double", str: "string"}
_TRANSFORMS: Final = "tf2_msgs/msg/TFMessage"
_MAX_STEPS: Final = 10
_SELF: Final = frozenset({"self"})

_Side = Literal["publishes", "subscribes"]
_Class = python_files.Definition
"""A class of a node, and the file that defines it."""


class _Helper(msgspec.Struct, frozen=True):
    """A class of another package whose constructor gets the node.

    Attributes:
        publishes: the types of the topics that it publishes for the node, by their names.
        subscribes: likewise.
        makes_subscription: whether its arguments after the node are those of a subscription.
        names_action: whether its second argument is the type, and its third the name of an action.
        answers: whether it is the server of this action.
    """

    publishes: Mapping[str, str] = msgspec.field(default_factory=dict)
    subscribes: Mapping[str, str] = msgspec.field(default_factory=dict)
    makes_subscription: bool = False
    names_action: bool = False
    answers: bool = False


_HELPERS: Final[Mapping[str, _Helper]] = {
    "message_filters.Subscriber": _Helper(makes_subscription=True),
    "rclpy.ActionClient": _Helper(names_action=True),
    "rclpy.ActionServer": _Helper(names_action=True, answers=True),
    "tf2_ros.Buffer": _Helper(),
    "tf2_ros.StaticTransformBroadcaster": _Helper(publishes={"/tf_static": _TRANSFORMS}),
    "tf2_ros.TransformBroadcaster": _Helper(publishes={"/tf": _TRANSFORMS}),
    "tf2_ros.TransformListener": _Helper(
        subscribes={"/tf": _TRANSFORMS, "/tf_static": _TRANSFORMS}
    ),
}
"""Helpers by package and name; which module of the package has them makes no difference."""


def unknown_interface(why: str) -> InterfaceEntry:
    """Return the interface of a node of which nothing is known, with the reason."""
    return InterfaceEntry(
        None, None, None, origin="source", may_publish_more=why, may_subscribe_more=why
    )


def read_node_class(
    tree: ast.Module,
    name: str,
    path: Path | None = None,
    read: python_files.ReadSource = lambda _: None,
) -> InterfaceEntry:
    """Return the interface of a class, or of a function that creates a node.

    Args:
        tree: of the file.
        name: of the class or the function.
        path: of the file, absolute; without one, its imports are not followed.
        read: reads other files of its package.
    """
    found = python_files.find_definition(python_files.source_file(tree, path, read), name)
    if found is None:
        return unknown_interface(f"{name} is not a class of its file")
    classes = [found] if isinstance(found.node, ast.ClassDef) else _made_classes(found)
    created = [] if isinstance(found.node, ast.ClassDef) else [*_creations(found)]
    reading = _Reading()
    if len(classes) + len(created) != 1:
        number = len(classes) + len(created)
        return unknown_interface(f"{name} makes {number or 'no'} nodes of classes that are read")
    if created:
        reading.add_function(found, *created[0])
        return reading.entry()
    for definition in _class_and_bases(classes[0]):
        reading.add_class(definition)
    return reading.entry()


def _made_classes(found: python_files.Definition) -> list[_Class]:
    """Return the classes of nodes that a function calls."""
    called = {
        node.func.id
        for node in own_nodes(found.node.body)
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name)
    }
    return [
        definition
        for each in sorted(called)
        if (definition := python_files.find_definition(found.file, each)) is not None
        and isinstance(definition.node, ast.ClassDef)
        and _is_node(definition)
    ]


def _creations(found: python_files.Definition) -> Iterator[tuple[str, ast.Call]]:
    """Yield the variables that get a node without a class of its own, and what creates it."""
    for node in [*ast.walk(found.node), *found.file.tree.body]:
        match node:
            case (
                ast.Assign(targets=[target], value=ast.Call() as call)
                | ast.AnnAssign(target=target, value=ast.Call() as call)
            ) if found.file.names.full_name(call.func) in _CREATED:
                yield ast.unparse(target), call


def _class_and_bases(found: _Class) -> Iterator[_Class]:
    """Yield a class, and the base classes that can be read, the nearest first."""
    for _ in range(MAX_BASE_CLASSES):
        yield found
        match found.node:
            case ast.ClassDef(bases=[ast.Name(id=name)]):
                above = python_files.find_definition(found.file, name)
            case _:
                return
        if above is None or not isinstance(above.node, ast.ClassDef) or above.node is found.node:
            return
        found = above


def _base_name(found: _Class) -> str:
    """Return the full name of the only base class.

    Empty if there are others or it is not imported.
    """
    bases = found.node.bases if isinstance(found.node, ast.ClassDef) else []
    return found.file.names.full_name(bases[0]) if len(bases) == 1 else ""


def _is_node(found: _Class) -> bool:
    """Return whether the class creates something of a node, or inherits from its class."""
    for definition in _class_and_bases(found):
        if _base_name(definition) in _NODES | _LIFECYCLE_NODES:
            return True
    return any(
        _method_of_node(node).startswith("create_")
        for node in ast.walk(found.node)
        if isinstance(node, ast.Call)
    )


class _Reading:
    """What the classes of a node say of it, so far."""

    def __init__(self) -> None:
        self._topics: dict[_Side, dict[str, str]] = {"publishes": {}, "subscribes": {}}
        self._more: dict[_Side, str] = {"publishes": "", "subscribes": ""}
        self._parameters: dict[str, ParameterInfo] = {}
        self._knows_parameters = True
        self._qos: dict[str, QoS] = {}
        self._publishing: dict[str, None] = {}
        self._unread_qos: dict[str, int] = {}
        self._methods: dict[str, ast.FunctionDef] = {}
        self._services: dict[str, str] = {}
        self._name = ""
        self._lifecycle = False

    def add_class(self, found: _Class) -> None:
        """Take the text of a class into account."""
        assert isinstance(found.node, ast.ClassDef)  # noqa: S101 - `_class_and_bases` gives no other
        base = _base_name(found)
        self._lifecycle = self._lifecycle or base in _LIFECYCLE_NODES
        if base not in _NODES | _LIFECYCLE_NODES and not _has_read_base(found):
            bases = ", ".join(map(ast.unparse, found.node.bases)) or "nothing"
            self._doubt_all(f"{found.node.name} inherits from {bases}, which may have others")
        # A constant of the class is read by `self`, or by its name.
        attributes = {
            f"{owner}.{name}": value
            for name, value in single_values(found.node, found.node.body).items()
            for owner in ("self", found.node.name)
        }
        self._methods |= {
            method.name: method
            for method in found.node.body
            if isinstance(method, ast.FunctionDef) and method.name not in self._methods
        }
        for method in found.node.body:
            values = {**attributes, **single_values(method)}
            self._add_calls(Scope(found.file, values, self._methods, method, _SELF))

    def add_function(self, found: python_files.Definition, owner: str, call: ast.Call) -> None:
        """Take a function into account that creates a node without a class of its own."""
        self._lifecycle = found.file.names.full_name(call.func) in _LIFECYCLE_NODES
        self._add_base_constructor(call)
        top = {
            each.name: each for each in found.file.tree.body if isinstance(each, ast.FunctionDef)
        }
        functions = [(found.node, owner)]
        for function, name in functions:
            inside = [each for each in ast.walk(function) if isinstance(each, ast.FunctionDef)]
            self._methods = {**top, **{each.name: each for each in inside}}
            owners = frozenset({name, owner})
            values = {**single_values(function), name: None}
            calls = Scope(found.file, values, self._methods, function, owners)
            for called, parameter in self._add_calls(calls):
                if (called, parameter) not in functions:
                    functions.append((called, parameter))

    def _add_calls(self, scope: Scope) -> list[tuple[ast.FunctionDef, str]]:
        """Take all calls of a text into account; returns the functions that get the node."""
        given = []
        for call in _calls(scope.node):
            inner = _given_to(call, scope)
            if inner is None:
                self._add_call(call, scope)
            else:
                given.append(inner)
        return given

    def _doubt(self, side: _Side, why: str) -> None:
        self._more[side] = self._more[side] or why

    def _doubt_all(self, why: str) -> None:
        self._doubt("publishes", why)
        self._doubt("subscribes", why)
        self._knows_parameters = False

    def _add_call(self, call: ast.Call, scope: Scope) -> None:
        method = _method_of_node(call, scope.owners)
        if method in _PUBLISHER_METHODS:
            self._add_topic("publishes", call, scope)
        elif method == "create_subscription":
            self._add_topic("subscribes", call, scope)
        elif method == "create_service":
            self._add_service(call, scope, "srv", first=0)
        elif method in {"declare_parameter", "declare_parameters"}:
            self._add_parameters(call, method)
        elif method == "__init__":
            self._add_base_constructor(call)
        elif not method and _passes_node(call, scope):
            self._add_helper(call, scope)

    def _add_topic(self, side: _Side, call: ast.Call, scope: Scope, first: int = 0) -> None:
        """Take a publisher or a subscription into account, whose type is the argument `first`."""
        topic = _text(_argument(call, first + 1, "topic"), scope)
        if topic is None:
            what = "publisher" if side == "publishes" else "subscription"
            self._doubt(side, f"line {call.lineno} makes a {what} whose topic is no literal")
            return
        written = _interface_type(_argument(call, first, "msg_type"), scope.file.names)
        if self._topics[side].setdefault(topic, written) != written:
            self._topics[side][topic] = ""
        given = _argument(call, first + (2 if side == "publishes" else 3), "qos_profile")
        qos = read_profile(given, scope)
        is_overridden = any(keyword.arg == "qos_overriding_options" for keyword in call.keywords)
        if qos is not None and not is_overridden:
            self._qos[topic] = qos
        if side == "subscribes" and given is not None and qos is None:
            self._unread_qos[topic] = call.lineno
        callback = _argument(call, first + 2, "callback")
        if side == "subscribes" and _publishes(callback, scope):
            self._publishing[topic] = None

    def _add_helper(self, call: ast.Call, scope: Scope) -> None:
        """Take the topics into account that a class of another package makes for the node."""
        names = scope.file.names
        package, _, inside = names.full_name(call.func).partition(".")
        helper = _HELPERS.get(f"{package}.{inside.rpartition('.')[2]}")
        if helper is None:
            self._doubt_all(f"line {call.lineno} passes the node to {ast.unparse(call.func)}()")
            return
        self._topics["publishes"].update(helper.publishes)
        self._topics["subscribes"].update(helper.subscribes)
        if helper.makes_subscription:
            self._add_topic("subscribes", call, scope, first=1)
        if helper.names_action:
            self._add_service(call, scope, "action", first=1, answers=helper.answers)

    def _add_service(
        self,
        call: ast.Call,
        scope: Scope,
        kind: Literal["srv", "action"],
        *,
        first: int,
        answers: bool = True,
    ) -> None:
        """Take a service or an action into account: its type is an argument, its name the next."""
        name = _text(_argument(call, first + 1, f"{kind}_name"), scope)
        if name is not None:
            given = _argument(call, first, f"{kind}_type")
            written = _interface_type(given, scope.file.names, kind)
            self._services[name] = written if answers else ""

    def _add_parameters(self, call: ast.Call, method: str) -> None:
        declared = _declared_parameters(call, method)
        if declared is None:
            self._knows_parameters = False
        else:
            self._parameters.update(declared)

    def _add_base_constructor(self, call: ast.Call) -> None:
        """Take the arguments of ``super().__init__`` into account."""
        match _argument(call, 0, "node_name"):
            case ast.Constant(value=str(name)):
                self._name = self._name or name
        for keyword in call.keywords:
            if keyword.arg == "cli_args":
                self._doubt_all(f"line {call.lineno} sets cli_args, which may rename topics")
            if keyword.arg in _PARAMETER_OPTIONS and ast.unparse(keyword.value) != "False":
                self._knows_parameters = False

    def _settle_parameters_in_topics(self) -> None:
        """Leave out topics that are named by parameters whose default the text does not say."""
        for side, topics in self._topics.items():
            for topic in [each for each in topics if each.startswith("$(parameter ")]:
                name = topic.removeprefix("$(parameter ").removesuffix(")")
                declared = self._parameters.get(name)
                if declared is None or not isinstance(declared.default, str):
                    del topics[topic]
                    self._doubt(side, f"the default of parameter {name!r} is no literal")

    def entry(self) -> InterfaceEntry:
        """Return the interface."""
        self._settle_parameters_in_topics()
        return InterfaceEntry(
            subscribes=self._topics["subscribes"],
            publishes=self._topics["publishes"],
            parameters=self._parameters if self._knows_parameters else None,
            services=self._services,
            qos=self._qos,
            publishing=tuple(self._publishing),
            unread_qos=self._unread_qos,
            origin="source",
            name=self._name,
            may_publish_more=self._more["publishes"],
            may_subscribe_more=self._more["subscribes"],
            is_lifecycle=self._lifecycle,
        )


def _has_read_base(found: _Class) -> bool:
    return len([*zip(_class_and_bases(found), range(2), strict=False)]) > 1


def _is_node_itself(node: ast.AST, owners: frozenset[str]) -> bool:
    """Return whether an expression is the node, or a call of `super`."""
    if isinstance(node, ast.Call):
        return isinstance(node.func, ast.Name) and node.func.id == "super"
    return isinstance(node, ast.Name | ast.Attribute) and ast.unparse(node) in owners


def _method_of_node(call: ast.Call, owners: frozenset[str] = _SELF) -> str:
    """Return the method of ``self.method(...)`` or ``super().method(...)``.

    Empty for any other call.
    """
    called = call.func
    is_method = isinstance(called, ast.Attribute) and _is_node_itself(called.value, owners)
    return called.attr if isinstance(called, ast.Attribute) and is_method else ""


def _publishes(callback: ast.AST | None, scope: Scope) -> bool:
    """Return True if a callback calls ``publish``, itself or by what it calls."""
    called = [callback]
    seen: list[ast.AST] = []
    for each in called:
        function: ast.AST | None = None
        match each.func if isinstance(each, ast.Call) else each:
            case ast.Attribute(attr="publish"):
                return True
            case ast.Attribute(value=owner, attr=name) if _is_node_itself(owner, scope.owners):
                function = scope.functions.get(name)
            case ast.Name(id=name):
                function = scope.functions.get(name)
            case ast.Lambda():
                function = each
        if function is not None and function not in seen:
            seen.append(function)
            called += _calls(function)
    return False


def _passes_node(call: ast.Call, scope: Scope) -> bool:
    """Return whether the node is an argument of a call that may create something of it."""
    arguments = (*call.args, *(keyword.value for keyword in call.keywords))
    is_passed = any(
        not isinstance(each, ast.Call) and _is_node_itself(each, scope.owners) for each in arguments
    )
    used = isinstance(call.func, ast.Attribute) and call.func.attr in _USERS
    spins = scope.file.names.full_name(call.func).startswith("rclpy.spin")
    return is_passed and not used and not spins and not _is_node_itself(call, scope.owners)


def _given_to(call: ast.Call, scope: Scope) -> tuple[ast.FunctionDef, str] | None:
    """Return the function of the file that a call gives the node, and what it is named there."""
    function = scope.functions.get(call.func.id) if isinstance(call.func, ast.Name) else None
    if function is None or "self" in scope.owners:
        return None
    parameters = [each.arg for each in function.args.args]
    given = [*zip(parameters, call.args, strict=False)]
    given += [(each.arg, each.value) for each in call.keywords if each.arg]
    nodes = [name for name, value in given if _is_node_itself(value, scope.owners)]
    # A variable of the file is the node everywhere.
    nodes += [name for name in scope.owners & _names(function) if name not in parameters]
    return (function, nodes[0]) if nodes else None


@lru_cache(maxsize=1_000)
def _calls(function: ast.AST) -> tuple[ast.Call, ...]:
    """Return the calls in a function."""
    return tuple(node for node in ast.walk(function) if isinstance(node, ast.Call))


@lru_cache(maxsize=1_000)
def _names(function: ast.FunctionDef) -> frozenset[str]:
    """Return the names in a function."""
    return frozenset(node.id for node in ast.walk(function) if isinstance(node, ast.Name))


def _argument(call: ast.Call, position: int, name: str) -> ast.expr | None:
    """Return an argument by its position or its name; None if it is not given, or by ``*``."""
    if any(isinstance(argument, ast.Starred) for argument in call.args):
        return None
    if len(call.args) > position:
        return call.args[position]
    return next((keyword.value for keyword in call.keywords if keyword.arg == name), None)


def _text(node: ast.expr | None, scope: Scope) -> str | None:
    """Return the text that an expression means, or ``$(parameter NAME)``.

    None if it is no literal.
    """
    for _ in range(_MAX_STEPS):
        match node:
            case ast.Name(id=name):
                values = scope.values
                node = values[name] if name in values else scope.file.names.constant(name)
            case ast.Constant(value=str(text)):
                return text
            case ast.Attribute(value=inner, attr=attribute) if attribute in _PARAMETER_VALUES:
                return _parameter(inner, scope)
            case _:
                return None
    return None


def _parameter(node: ast.expr | None, scope: Scope) -> str | None:
    """Return the reference to a parameter that an expression is, or whose value it is."""
    for _ in range(_MAX_STEPS):
        match node:
            case ast.Name(id=name):
                node = scope.values.get(name)
            case ast.Call(func=ast.Attribute(value=inner, attr="get_parameter_value")):
                node = inner
            case ast.Call(args=[ast.Constant(value=str(name)), *_]) if (
                _method_of_node(node, scope.owners) in _PARAMETER_SOURCES
            ):
                return f"$(parameter {name})"
            case _:
                return None
    return None


def _interface_type(
    given: ast.expr | None, names: SourceNames, kind: Literal["msg", "srv", "action"] = "msg"
) -> str:
    """Return the type of this kind that a class stands for; empty if the text does not say it."""
    if given is None:
        return ""
    package, middle, name = (["", "", *names.full_name(given).split(".")])[-3:]
    return f"{package}/{kind}/{name}" if middle == kind and package else ""


def _declared_parameters(call: ast.Call, method: str) -> list[tuple[str, ParameterInfo]] | None:
    """The parameters of ``declare_parameter(name, value)`` or ``declare_parameters("", [...])``.

    None if their names are no literals.
    """
    if method == "declare_parameter":
        described = any(each.arg == "descriptor" for each in call.keywords) or len(call.args) > 2
        found = [_declared(_argument(call, 0, "name"), _argument(call, 1, "value"), described)]
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
