"""The nodes, containers and included launch files of a list of launch actions.

Actions are the constructs that a script or a launch file returns. Groups pass their namespace and
remappings to what is in them, as `launch_ros` does: remappings that a group sets come first.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field, replace
from typing import Any

from r2bspec.interop.script_import.launch_conditions import condition_value
from r2bspec.interop.script_import.script_values import (
    Construct,
    Place,
    PlacedTuple,
    Unknown,
    unknown_in,
)

CONTAINER_EXECUTABLES = frozenset(
    {"component_container", "component_container_mt", "component_container_isolated"}
)

_IGNORED = frozenset(
    {
        "DeclareLaunchArgument",
        "LogInfo",
        "ReadyToTest",
        "Shutdown",
        "EmitEvent",
    }
)


@dataclass(frozen=True, slots=True)
class Remapping:
    """One remapping: what the node calls it, and the topic to use; `node` limits it to one node."""

    source: str
    target: str
    place: Place
    node: str = ""


@dataclass(slots=True)
class NodeAction:
    """A node that a script starts or loads.

    Attributes:
        namespace: absolute; empty for none.
        parameters: maps and paths of files, in order.
        container: the name of the container that it is loaded into.
        source: the construct that it comes from.
    """

    name: str
    source: Construct
    package: str = ""
    plugin: str = ""
    executable: str = ""
    command: list[str] = field(default_factory=list)
    namespace: str = ""
    parameters: list[Any] = field(default_factory=list)
    remappings: list[Remapping] = field(default_factory=list)
    arguments: list[str] = field(default_factory=list)
    container: str = ""


@dataclass(slots=True)
class ContainerAction:
    """A component container."""

    name: str
    executable: str
    source: Construct


@dataclass(slots=True)
class IncludeAction:
    """An included launch file.

    Attributes:
        package: the package of the file; empty with `path`.
        file: relative to the share folder of the package.
    """

    source: Construct
    package: str = ""
    file: str = ""
    path: str = ""
    arguments: dict[str, Any] = field(default_factory=dict)
    namespace: str = ""
    remappings: list[Remapping] = field(default_factory=list)


@dataclass(slots=True)
class LaunchParts:
    """Everything that a list of actions starts, and what was not understood."""

    nodes: list[NodeAction] = field(default_factory=list)
    containers: list[ContainerAction] = field(default_factory=list)
    includes: list[IncludeAction] = field(default_factory=list)
    ignored: list[tuple[str, Place]] = field(default_factory=list)


@dataclass(frozen=True, slots=True)
class _Group:
    """What a group passes on."""

    namespace: str = ""
    remappings: tuple[Remapping, ...] = ()


Expand = Callable[[IncludeAction, str], list[Any] | None]
"""The actions of an included launch file, or None to keep it as one."""


def collect_actions(actions: Iterable[Any], expand: Expand) -> LaunchParts:
    """The parts of a list of actions.

    Args:
        actions: constructs.
        expand: is called for each included launch file, with the namespace of its group.
    """
    parts = LaunchParts()
    _Collector(parts, expand).add_all(list(actions), _Group())
    return parts


@dataclass(slots=True)
class _Collector:
    parts: LaunchParts
    expand: Expand
    depth: int = 0

    def add_all(self, actions: list[Any], group: _Group) -> None:
        for action in actions:
            group = self.add(action, group)

    def add(self, action: Any, group: _Group) -> _Group:
        """Add an action; returns what applies to the actions after it."""
        if isinstance(action, list | tuple):
            self.add_all(list(action), group)
            return group
        if not isinstance(action, Construct):
            if isinstance(action, Unknown):
                self.parts.ignored.append((action.reason, action.place))
            return group
        kind = action.short_name
        if not self._condition_is_met(action):
            return group
        if kind == "SetRemap":
            return self._with_remapping(action, group)
        if kind == "PushRosNamespace":
            name = _text(action.get("namespace", 0), "")
            return replace(group, namespace=_join(group.namespace, name))
        known = _ACTIONS.get(kind)
        if known is not None:
            known(self, action, group)
        elif kind not in _IGNORED:
            self.parts.ignored.append((f"{kind} has no form in a spec", action.place))
        return group

    def _condition_is_met(self, action: Construct) -> bool:
        decided = condition_value(action.get("condition"))
        if decided is None:
            self._ignore(
                f"the condition of {action.short_name} is not known, so it is left out", action
            )
        return decided is True

    def _with_remapping(self, action: Construct, group: _Group) -> _Group:
        source, target = action.get("src", 0), action.get("dst", 1)
        if not isinstance(source, str) or not isinstance(target, str):
            self.parts.ignored.append(("a remapping that is not known", action.place))
            return group
        node, _, name = source.rpartition(":")
        made = Remapping(name, target, action.place, node)
        return replace(group, remappings=(*group.remappings, made))

    def group(self, action: Construct, group: _Group) -> None:
        self.add_all(_list(action.get("actions", 0)), group)

    def timer(self, action: Construct, group: _Group) -> None:
        self._ignore("the delay of a TimerAction is left out: readiness is observed", action)
        self.add_all(_list(action.get("actions")), group)

    def handler(self, action: Construct, group: _Group) -> None:
        """An event handler: what it starts when another process starts, ends or prints."""
        event = action.get("event_handler", 0)
        values = (
            [*event.keywords.values(), *event.arguments] if isinstance(event, Construct) else []
        )
        started = [
            one
            for each in values
            for one in (each if isinstance(each, list | tuple) else [each])
            if isinstance(one, Construct) and one.short_name in _STARTS
        ]
        if started:
            self._ignore("what an event handler starts is left out", action)
        del group

    def node(self, action: Construct, group: _Group) -> None:
        executable = _text(action.get("executable"), "")
        if executable in CONTAINER_EXECUTABLES:
            name = _text(action.get("name"), "container")
            self.parts.containers.append(ContainerAction(name, executable, action))
        elif self._is_known(action, "package", "executable"):
            made = self._node(action, group)
            made.executable = executable
            for each in _list(action.get("arguments")):
                if not isinstance(each, str | int | float):
                    self._ignore("an argument is left out: its value is not known", action)
            made.arguments = _texts(action.get("arguments"))
            self.parts.nodes.append(made)

    def process(self, action: Construct, group: _Group) -> None:
        del group
        command = _texts(action.get("cmd", 0))
        name = _text(action.get("name"), command[0].rpartition("/")[2] if command else "process")
        made = NodeAction(name, action, command=command)
        self.parts.nodes.append(made)

    def container(self, action: Construct, group: _Group) -> None:
        name = _text(action.get("name"), "container")
        executable = _text(action.get("executable"), "component_container")
        if executable not in CONTAINER_EXECUTABLES:
            self.parts.ignored.append((f"{executable!r} is no known container", action.place))
            executable = "component_container_mt"
        self.parts.containers.append(ContainerAction(name, executable, action))
        for each in _list(action.get("composable_node_descriptions")):
            self._component(each, group, name)

    def load(self, action: Construct, group: _Group) -> None:
        target = action.get("target_container", 1)
        name = target.get("name") if isinstance(target, Construct) else target
        container = _text(name, "container").rpartition("/")[2]
        for each in _list(action.get("composable_node_descriptions", 0)):
            self._component(each, group, container)

    def _component(self, action: Any, group: _Group, container: str) -> None:
        if isinstance(action, Unknown):
            self.parts.ignored.append((action.reason, action.place))
        if not isinstance(action, Construct) or not self._condition_is_met(action):
            return
        if action.short_name != "ComposableNode":
            self._ignore(f"the node that {action.short_name} makes is not known", action)
            return
        if not self._is_known(action, "package", "plugin"):
            return
        made = self._node(action, group)
        made.plugin, made.container = _text(action.get("plugin"), ""), container
        self.parts.nodes.append(made)

    def _is_known(self, action: Construct, *keys: str) -> bool:
        """Whether a file tells what it starts: a node without that has no form in a spec."""
        for key in keys:
            value = action.get(key)
            if not _text(value, ""):
                missing = unknown_in(value)
                why = missing.reason if missing is not None else f"its {key} is not known"
                self._ignore(f"{action.short_name} is left out: {why}", action)
                return False
        for key in ("name", "namespace"):
            if action.get(key) is not None and not isinstance(action.get(key), str | list):
                self._ignore(f"the {key} of {action.short_name} is not known", action)
        return True

    def _ignore(self, reason: str, action: Construct) -> None:
        self.parts.ignored.append((reason, action.place))

    def _node(self, action: Construct, group: _Group) -> NodeAction:
        default = _text(action.get("plugin"), "").rpartition("::")[2]
        name = _text(action.get("name"), default or _text(action.get("executable"), "node"))
        own = _pairs(action.get("remappings"), action.place_of("remappings"))
        for each in _list(action.get("remappings")):
            missing = unknown_in(each)
            if missing is not None:
                self.parts.ignored.append((f"a remapping: {missing.reason}", missing.place))
        return NodeAction(
            name,
            action,
            package=_text(action.get("package"), ""),
            namespace=_absolute(_join(group.namespace, _text(action.get("namespace"), ""))),
            parameters=_list(action.get("parameters")),
            remappings=[*(one for one in group.remappings if one.node in {"", name}), *own],
        )

    def include(self, action: Construct, group: _Group) -> None:
        made = _include(action, group)
        if made is None:
            self.parts.ignored.append(("the file of an included launch file", action.place))
            return
        inner = self.expand(made, group.namespace) if self.depth < 5 else None
        if inner is None:
            self.parts.includes.append(made)
            return
        self.depth += 1
        self.add_all(inner, group)
        self.depth -= 1


_ACTIONS: dict[str, Callable[[_Collector, Construct, _Group], None]] = {
    "GroupAction": _Collector.group,
    "TimerAction": _Collector.timer,
    "RegisterEventHandler": _Collector.handler,
    "LaunchDescription": lambda all_, action, group: all_.add_all(
        _list(action.get("initial_entities", 0)), group
    ),
    "Node": _Collector.node,
    "LifecycleNode": _Collector.node,
    "ExecuteProcess": _Collector.process,
    "ComposableNodeContainer": _Collector.container,
    "LoadComposableNodes": _Collector.load,
    "IncludeLaunchDescription": _Collector.include,
}

_STARTS = frozenset(_ACTIONS) - {"RegisterEventHandler"}


def _include(action: Construct, group: _Group) -> IncludeAction | None:
    source = action.get("launch_description_source", 0)
    if isinstance(source, Construct):
        source = source.get("location", 0)
    if isinstance(source, list | tuple) and all(isinstance(each, str) for each in source):
        source = "".join(source)
    if not isinstance(source, str):
        return None
    given = action.get("launch_arguments", default=[])
    pairs = given.items() if isinstance(given, dict) else _list(given)
    arguments = {
        str(each[0]): each[1] for each in pairs if isinstance(each, list | tuple) and len(each) == 2
    }
    made = IncludeAction(
        action,
        arguments=arguments,
        namespace=_absolute(group.namespace),
        remappings=list(group.remappings),
    )
    start = "$(share "
    if source.startswith(start) and ")/" in source:
        made.package, _, made.file = source.removeprefix(start).partition(")/")
    else:
        made.path = source
    return made


def _pairs(value: Any, place: Place) -> list[Remapping]:
    found = []
    for each in _list(value):
        if isinstance(each, list | tuple) and len(each) == 2:
            # A text may be written as a list of parts, such as launch substitutions.
            names = [_text(one, "") for one in each]
            if all(names):
                where = each.place if isinstance(each, PlacedTuple) else place
                found.append(Remapping(names[0], names[1], where))
    return found


def _text(value: Any, default: str) -> str:
    if isinstance(value, list | tuple) and all(isinstance(each, str) for each in value):
        return "".join(value) or default
    return value if isinstance(value, str) and value else default


def _texts(value: Any) -> list[str]:
    return [str(each) for each in _list(value) if isinstance(each, str | int | float)]


def _list(value: Any) -> list[Any]:
    if isinstance(value, Unknown):
        return [value]
    return list(value) if isinstance(value, list | tuple) else []


def _join(above: str, namespace: str) -> str:
    if namespace.startswith("/") or not above:
        return namespace
    return f"{above.rstrip('/')}/{namespace}" if namespace else above


def _absolute(namespace: str) -> str:
    return f"/{namespace.strip('/')}" if namespace.strip("/") else ""
