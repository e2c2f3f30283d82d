"""Reading a node's topics, services, parameters and start from its Python source, unexecuted.

Every call of `create_publisher`, `create_subscription`, `create_service` and `declare_parameter` on
`self` counts, in the class and in the base classes that its package defines. A class whose calls
have literal arguments is complete: a topic is a literal, a name that is bound to a literal once, or
the value of a parameter with a literal name; a QoS profile is a depth, a preset of rclpy, or
``QoSProfile(...)`` of literals, inline or bound once, also by a file of the package. Otherwise, and
if the node is passed to unknown code, the interface says why there may be more; the verb
`interfaces` records it. A function has the interface of the only node class that it instantiates.

How a node can be started: a constructor that passes its ``**kwargs`` to `Node` receives name,
namespace, remappings and parameters as keyword arguments. A constructor without them receives these
as the global ROS arguments of a process, as by ``ros2 run``, so that its process can hold no other
node. A function that calls ``rclpy.init`` itself, such as the ``main`` of an ordinary node, is a
program of its own.
"""

from __future__ import annotations

import ast
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any, Final, Literal, NamedTuple, get_args, get_type_hints

import msgspec

from r2bspec.language.quantities import Duration
from r2bspec.language.spec import QoS
from r2bspec.plan.wiring.node_interface import InterfaceEntry, ParameterInfo, ParameterType
from r2bspec.plan.wiring.python_files import Definition, ReadSource, SourceFile, find_definition
from r2bspec.safe_io.limits import MAX_BASE_CLASSES

_NODES: Final = frozenset({"rclpy.Node", "rclpy.node.Node"})
_LIFECYCLE_NODES: Final = frozenset(
    f"rclpy.lifecycle.{name}" for name in ("LifecycleNode", "Node", "node.LifecycleNode")
)
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

_Side = Literal["publishes", "subscribes"]


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
    read: ReadSource = lambda _: None,
) -> InterfaceEntry:
    """Return the interface of a class, or of a function that creates a node.

    Args:
        tree: the syntax tree of the file.
        name: the name of the class or the function.
        path: the path of the file, absolute; without one, its imports are not followed.
        read: reads other files of its package.
    """
    found = find_definition(SourceFile(tree, path, read), name)
    if found is None:
        return unknown_interface(f"{name} is not a class of its file")
    classes = [found] if isinstance(found.node, ast.ClassDef) else _made_classes(found)
    if len(classes) != 1:
        return unknown_interface(f"{name} makes {len(classes) or 'no'} nodes of classes it names")
    reading = _Reading()
    for definition in _class_and_bases(classes[0]):
        reading.add_class(definition)
    return reading.entry()


def _made_classes(found: Definition) -> list[Definition]:
    """Return the classes of nodes that a function calls."""
    called = {
        node.func.id
        for node in _own_nodes(found.node.body)
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name)
    }
    made = (find_definition(found.file, name) for name in sorted(called))
    return [each for each in made if each is not None and _is_node(each)]


def _class_and_bases(found: Definition) -> Iterator[Definition]:
    """Yield a class, and the base classes that can be read, the nearest first."""
    for _ in range(MAX_BASE_CLASSES):
        yield found
        match found.node:
            case ast.ClassDef(bases=[ast.Name(id=name)]):
                above = find_definition(found.file, name)
            case _:
                return
        if above is None or not isinstance(above.node, ast.ClassDef) or above.node is found.node:
            return
        found = above


def _base_name(found: Definition) -> str:
    """Return the full name of the only base class.

    Empty if there are others or it is not imported.
    """
    bases = found.node.bases if isinstance(found.node, ast.ClassDef) else []
    return found.file.full_name(bases[0]) if len(bases) == 1 else ""


def _is_node(found: Definition) -> bool:
    """Return whether a definition is a class that creates something of a node, or inherits it."""
    if not isinstance(found.node, ast.ClassDef):
        return False
    bases = map(_base_name, _class_and_bases(found))
    return not (_NODES | _LIFECYCLE_NODES).isdisjoint(bases) or any(
        _method_of_node(node).startswith("create_")
        for node in ast.walk(found.node)
        if isinstance(node, ast.Call)
    )


class _Scope(NamedTuple):
    """Where an expression stands.

    Attributes:
        file: with the text.
        values: the only value of each variable, ``self.NAME`` too; None if there are others.
        methods: the methods of the class and of its subclasses, by their names.
    """

    file: SourceFile
    values: Mapping[str, ast.expr | None]
    methods: Mapping[str, ast.FunctionDef]

    def meaning(self, node: ast.expr | None) -> ast.expr | None:
        """Return the expression that gives a variable its value; other expressions as they are."""
        for _ in range(_MAX_STEPS):
            if not isinstance(node, ast.Name | ast.Attribute):
                return node
            written = ast.unparse(node)
            constant = self.file.constant(written)
            if written in self.values:
                node = self.values[written]
            elif constant is not None:
                node = constant
            else:
                return node
        return None


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

    def add_class(self, found: Definition) -> None:
        """Take the text of a class into account."""
        assert isinstance(found.node, ast.ClassDef)  # noqa: S101 - `_class_and_bases` gives no other
        base = _base_name(found)
        self._lifecycle = self._lifecycle or base in _LIFECYCLE_NODES
        has_read_base = len(list(_class_and_bases(found))) > 1
        if base not in _NODES | _LIFECYCLE_NODES and not has_read_base:
            bases = ", ".join(map(ast.unparse, found.node.bases)) or "nothing"
            self._doubt_all(f"{found.node.name} inherits from {bases}, which may have others")
        # A constant of the class is read by `self`, or by its name.
        attributes = {
            f"{owner}.{name}": value
            for name, value in _single_values(found.node.body).items()
            for owner in ("self", found.node.name)
        }
        self._methods |= {
            method.name: method
            for method in found.node.body
            if isinstance(method, ast.FunctionDef) and method.name not in self._methods
        }
        for method in found.node.body:
            values = {**attributes, **_single_values(ast.walk(method))}
            scope = _Scope(found.file, values, self._methods)
            for node in ast.walk(method):
                if isinstance(node, ast.Call):
                    self._add_call(node, scope)

    def _doubt(self, side: _Side, why: str) -> None:
        self._more[side] = self._more[side] or why

    def _doubt_all(self, why: str) -> None:
        self._doubt("publishes", why)
        self._doubt("subscribes", why)
        self._knows_parameters = False

    def _add_call(self, call: ast.Call, scope: _Scope) -> None:
        method = _method_of_node(call)
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

    def _add_topic(self, side: _Side, call: ast.Call, scope: _Scope, first: int = 0) -> None:
        """Take a publisher or a subscription into account, whose type is the argument `first`."""
        topic = _text(_argument(call, first + 1, "topic"), scope)
        if topic is None:
            what = "publisher" if side == "publishes" else "subscription"
            self._doubt(side, f"line {call.lineno} makes a {what} whose topic is no literal")
            return
        written = _interface_type(_argument(call, first, "msg_type"), scope.file)
        if self._topics[side].setdefault(topic, written) != written:
            self._topics[side][topic] = ""
        given = _argument(call, first + (2 if side == "publishes" else 3), "qos_profile")
        qos = _profile(given, scope)
        is_overridden = any(keyword.arg == "qos_overriding_options" for keyword in call.keywords)
        if qos is not None and not is_overridden:
            self._qos[topic] = qos
        if side == "subscribes" and given is not None and qos is None:
            self._unread_qos[topic] = call.lineno
        callback = _argument(call, first + 2, "callback")
        if side == "subscribes" and callback is not None and _publishes(callback, scope.methods):
            self._publishing[topic] = None

    def _add_helper(self, call: ast.Call, scope: _Scope) -> None:
        """Take the topics into account that a class of another package makes for the node."""
        package, _, inside = scope.file.full_name(call.func).partition(".")
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
        scope: _Scope,
        kind: Literal["srv", "action"],
        *,
        first: int,
        answers: bool = True,
    ) -> None:
        """Take a service or an action into account: its type is an argument, its name the next."""
        name = _text(_argument(call, first + 1, f"{kind}_name"), scope)
        if name is not None:
            given = _argument(call, first, f"{kind}_type")
            self._services[name] = _interface_type(given, scope.file, kind) if answers else ""

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


def _own_nodes(statements: Iterable[ast.AST]) -> Iterator[ast.AST]:
    """Yield the nodes of statements, without those of nested functions and classes.

    Without recursion: each `elif` is one level deeper than the one before.
    """
    waiting = list(statements)
    while waiting:
        node = waiting.pop()
        if not isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.Lambda | ast.ClassDef):
            yield node
            waiting.extend(ast.iter_child_nodes(node))


def _single_values(nodes: Iterable[ast.AST]) -> dict[str, ast.expr | None]:
    """Return the only value of each variable, ``self.NAME`` too; None if it gets or is changed.

    Args:
        nodes: all of a method, or the statements of a class.
    """
    values: dict[str, ast.expr | None] = {}
    for node in nodes:
        match node:
            case ast.Assign(
                targets=[ast.Name() | ast.Attribute(value=ast.Name(id="self")) as target],
                value=value,
            ):
                name = ast.unparse(target)
                values[name] = None if name in values else value
            case ast.Assign(targets=[ast.Attribute(value=changed)]):
                values[ast.unparse(changed)] = None
            case (
                ast.AugAssign(target=ast.Name(id=name))
                | ast.For(target=ast.Name(id=name))
                | ast.arg(arg=name)
            ):
                values[name] = None
    return values


def _is_node_itself(node: ast.AST) -> bool:
    """Return whether an expression is the node, or a call of `super`."""
    if isinstance(node, ast.Call):
        return isinstance(node.func, ast.Name) and node.func.id == "super"
    return isinstance(node, ast.Name) and node.id == "self"


def _method_of_node(call: ast.Call) -> str:
    """Return the method of ``self.method(...)`` or ``super().method(...)``.

    Empty for any other call.
    """
    called = call.func
    return (
        called.attr if isinstance(called, ast.Attribute) and _is_node_itself(called.value) else ""
    )


def _publishes(callback: ast.AST, methods: Mapping[str, ast.FunctionDef]) -> bool:
    """Return True if a callback calls ``publish``, itself or by the methods that it calls."""
    names: set[str] = set()
    waiting = [callback]
    while waiting:
        for node in ast.walk(waiting.pop()):
            if isinstance(node, ast.Attribute) and node.attr == "publish":
                return True
            if isinstance(node, ast.Attribute) and _is_node_itself(node.value):
                if node.attr in methods and node.attr not in names:
                    waiting.append(methods[node.attr])
                names.add(node.attr)
    return False


def _passes_node(call: ast.Call, scope: _Scope) -> bool:
    """Return whether the node is an argument of a call that may create something of it."""
    arguments = (*call.args, *(keyword.value for keyword in call.keywords))
    is_passed = any(isinstance(each, ast.Name) and _is_node_itself(each) for each in arguments)
    used = isinstance(call.func, ast.Attribute) and call.func.attr in _USERS
    spins = scope.file.full_name(call.func).startswith("rclpy.spin")
    return is_passed and not used and not spins and not _is_node_itself(call)


def _argument(call: ast.Call, position: int, name: str) -> ast.expr | None:
    """Return an argument by its position or its name; None if it is not given, or by ``*``."""
    if any(isinstance(argument, ast.Starred) for argument in call.args):
        return None
    if len(call.args) > position:
        return call.args[position]
    return next((keyword.value for keyword in call.keywords if keyword.arg == name), None)


def _text(node: ast.expr | None, scope: _Scope) -> str | None:
    """Return the text that an expression means, or ``$(parameter NAME)``.

    None if it is no literal.
    """
    match scope.meaning(node) if isinstance(node, ast.Name) else node:
        case ast.Constant(value=str(text)):
            return text
        case ast.Attribute(value=inner, attr=attribute) if attribute in _PARAMETER_VALUES:
            match scope.meaning(inner):
                case ast.Call(func=ast.Attribute(value=parameter, attr="get_parameter_value")):
                    inner = parameter
            match scope.meaning(inner):
                case ast.Call(args=[ast.Constant(value=str(name)), *_]) as call if (
                    _method_of_node(call) in _PARAMETER_SOURCES
                ):
                    return f"$(parameter {name})"
    return None


def _interface_type(
    given: ast.expr | None, file: SourceFile, kind: Literal["msg", "srv", "action"] = "msg"
) -> str:
    """Return the type of this kind that a class stands for; empty if the text does not say it."""
    if given is None:
        return ""
    package, middle, name = (["", "", *file.full_name(given).split(".")])[-3:]
    return f"{package}/{kind}/{name}" if middle == kind and package else ""


def _declared_parameters(call: ast.Call, method: str) -> list[tuple[str, ParameterInfo]] | None:
    """Return the parameters of ``declare_parameter`` and ``declare_parameters`` calls.

    None if their names are no literals.
    """
    found: list[tuple[str, ParameterInfo] | None] = [None]
    if method == "declare_parameter":
        described = any(each.arg == "descriptor" for each in call.keywords) or len(call.args) > 2
        found = [_declared(_argument(call, 0, "name"), _argument(call, 1, "value"), described)]
    else:
        match call.args:
            case [ast.Constant(value=""), ast.List(elts=items) | ast.Tuple(elts=items)]:
                found = [
                    _declared(item.elts[0], item.elts[1], len(item.elts) > 2)
                    if isinstance(item, ast.Tuple) and len(item.elts) > 1
                    else None
                    for item in items
                ]
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


_PRESETS: Final = {
    "qos_profile_sensor_data": "sensor_data",
    "qos_profile_services_default": "services",
    "qos_profile_parameters": "parameters",
    "qos_profile_system_default": "system_default",
    "DEFAULT": "default",
    "SENSOR_DATA": "sensor_data",
    "SERVICES_DEFAULT": "services",
    "PARAMETERS": "parameters",
    "SYSTEM_DEFAULT": "system_default",
}
"""The presets of rclpy, by the names of `QoSPresetProfiles`, too."""

_FIELDS: Final = {
    **{name: name for name in ("history", "depth", "reliability", "durability")},
    **{name: name for name in ("deadline", "lifespan", "liveliness")},
    "liveliness_lease_duration": "lease_duration",
}
"""The fields of a profile in a spec, by their names in rclpy."""


def _profile(given: ast.expr | None, scope: _Scope) -> QoS | None:
    """Return the QoS profile that an argument means; None if the text does not say it."""
    meant = scope.meaning(given)
    match meant:
        case ast.Constant(value=int(depth)) if depth > 0 and not isinstance(depth, bool):
            return QoS.from_keys({"depth": depth})
        case ast.Call(func=made, args=[], keywords=keywords) if (
            scope.file.full_name(made).rpartition(".")[2] == "QoSProfile"
        ):
            fields = [_field(each.arg or "", scope.meaning(each.value), scope) for each in keywords]
            known = [field for field in fields if field is not None]
            return QoS.from_keys(dict(known)) if len(known) == len(fields) else None
        case ast.Name(id=name) if (place := scope.file.imported(name)) is not None:
            return _profile(ast.Name(place[1]), _Scope(place[0], {}, {}))
        case ast.Name() | ast.Attribute():
            full = scope.file.full_name(meant).removesuffix(".value")
            preset = _PRESETS.get(full.rpartition(".")[2]) if full.startswith("rclpy.") else None
            return None if preset is None else QoS.from_word(preset)
    return None


def _field(name: str, value: ast.expr | None, scope: _Scope) -> tuple[str, Any] | None:
    """Return a field as a spec has it; None if it is not known."""
    field = _FIELDS.get(name, "")
    match value:
        case ast.Constant(value=int(depth)) if field == "depth" and depth > 0:
            return field, depth
        case ast.Call(func=made, args=[], keywords=parts) if field.endswith(
            ("deadline", "span", "duration")
        ) and scope.file.full_name(made).endswith("Duration"):
            limit = _duration(parts)
            return (field, limit) if limit is not None else None
        case ast.Attribute(attr=policy) if field:
            words = get_args(get_type_hints(QoS).get(field))
            word = policy.lower().removeprefix(f"rmw_qos_policy_{field}_")
            return (field, word) if word in words else None
    return None


def _duration(parts: list[ast.keyword]) -> Duration | None:
    total_ns = 0.0
    for part in parts:
        match part.value:
            case ast.Constant(value=int() | float() as value):
                total_ns += value * {"seconds": 10**9, "nanoseconds": 1}.get(part.arg or "", 0)
            case _:
                return None
    return Duration(round(total_ns)) if total_ns > 0 else None


KEYWORD_ARGUMENTS: Final = (
    "namespace",
    "cli_args",
    "use_global_arguments",
    "parameter_overrides",
)
"""The keyword arguments of `Node` that r2bspec sets."""

StartStyle = Literal["keywords", "ros_arguments", "main"]
"""How a Python node is started: by keyword arguments of its constructor, by global ROS arguments of
a process of its own, or as a function that is a program."""


def read_start_style(tree: ast.Module, name: str) -> StartStyle | None:
    """Return how the class or function `name` of a file is started.

    None if the file does not say.
    """
    file = SourceFile(tree)
    match definition := file.definition(name):
        case ast.FunctionDef(decorator_list=[]):
            return "main" if _is_program(definition) else _style_of(definition.args, 0)
        case ast.ClassDef():
            constructor = _constructor(file, definition)
            return None if constructor is None else _style_of(constructor.args, 1)
    return None


def _constructor(file: SourceFile, found: ast.ClassDef) -> ast.FunctionDef | None:
    """Return the ``__init__`` of a class or of its base classes in the same file."""
    for _ in range(MAX_BASE_CLASSES):
        methods = {part.name: part for part in found.body if isinstance(part, ast.FunctionDef)}
        if found.decorator_list or found.keywords or "__new__" in methods:
            return None
        if (constructor := methods.get("__init__")) is not None:
            return None if constructor.decorator_list else constructor
        base = found.bases[0] if len(found.bases) == 1 else None
        above = file.definition(base.id) if isinstance(base, ast.Name) else None
        if not isinstance(above, ast.ClassDef):
            return None
        found = above
    return None


def _style_of(arguments: ast.arguments, bound: int) -> StartStyle:
    """Return the style of a callable; its first `bound` parameters are not the caller's."""
    names = {parameter.arg for parameter in (*arguments.args[bound:], *arguments.kwonlyargs)}
    has_keywords = arguments.kwarg is not None or names.issuperset(KEYWORD_ARGUMENTS)
    return "keywords" if has_keywords else "ros_arguments"


def _is_program(function: ast.FunctionDef) -> bool:
    """Return True if a function initialises ROS itself and returns no node."""
    nodes = list(_own_nodes(function.body))
    returned = (node.value for node in nodes if isinstance(node, ast.Return))
    return all(map(_is_exit_status, returned)) and any(
        isinstance(node, ast.Call) and ast.unparse(node.func) == "rclpy.init" for node in nodes
    )


def _is_exit_status(value: ast.expr | None) -> bool:
    return value is None or (isinstance(value, ast.Constant) and not isinstance(value.value, str))
