"""The nodes, containers and included launch files of a list of launch actions.

Actions are the constructs that a script or a launch file returns. Groups pass their namespace and
remappings to what is in them, as `launch_ros` does: remappings that a group sets come first. What
is started under a condition that is not known is left out with a note, and so is a node whose
program the file does not tell.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field, replace
from typing import Any, Final

from r2bspec.diagnostics import Span
from r2bspec.diagnostics.quote import clip
from r2bspec.interop.script_import.source_files import missing_module
from r2bspec.interop.script_import.substitutions import condition_value
from r2bspec.interop.script_import.values import (
    Construct,
    Note,
    PlacedTuple,
    ScriptLimitError,
    StepCounter,
    Unknown,
    unknown_in,
)
from r2bspec.safe_io.limits import MAX_LAUNCH_INCLUDES, MAX_LAUNCH_LEVELS, MAX_LAUNCH_PARTS

_CONTAINER_EXECUTABLES: Final = frozenset(
    {"component_container", "component_container_mt", "component_container_isolated"}
)
_IGNORED: Final = frozenset(
    {"DeclareLaunchArgument", "LogInfo", "ReadyToTest", "Shutdown", "EmitEvent"}
)


@dataclass(frozen=True, slots=True)
class Remapping:
    """One remapping: what the node calls it, and the topic to use; `node` limits it to one node."""

    source: str
    target: str
    place: Span
    node: str = ""


@dataclass(slots=True)
class NodeAction:
    """A node that a script starts or loads.

    Attributes:
        source: the construct that it comes from.
        namespace: absolute; empty for none.
        parameters: maps and paths of files, in order.
        container: the name of the container that it is loaded into.
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

    @property
    def plugin_class(self) -> str:
        """The last part of the plugin: ``ResizeNode``."""
        return self.plugin.rpartition("::")[2]

    def parameter(self, name: str) -> Any:
        """The last value of a parameter in the script; None without one."""
        values = [
            source[name]
            for source in self.parameters
            if isinstance(source, dict) and name in source
        ]
        return values[-1] if values else None

    def remapped(self, source: str) -> str:
        """What the node calls `source` in the graph; by default itself."""
        targets = (each.target for each in self.remappings if each.source.lstrip("/") == source)
        return next(targets, source)


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

    @property
    def name(self) -> str:
        """The name of the file."""
        return (self.file or self.path).rpartition("/")[2]


Member = NodeAction | IncludeAction


@dataclass(slots=True)
class LaunchParts:
    """Everything that a list of actions starts, and what was not understood.

    Attributes:
        containers: the executables of component containers, by name.
        missing: what is left out because a module was not found, by the name of the module.
    """

    nodes: list[NodeAction] = field(default_factory=list)
    containers: dict[str, str] = field(default_factory=dict)
    includes: list[IncludeAction] = field(default_factory=list)
    ignored: list[Note] = field(default_factory=list)
    missing: dict[str, list[Construct]] = field(default_factory=dict)

    @property
    def members(self) -> list[Member]:
        """Nodes and included files."""
        return [*self.nodes, *self.includes]


@dataclass(frozen=True, slots=True)
class _Group:
    """What a group passes on."""

    namespace: str = ""
    remappings: tuple[Remapping, ...] = ()


Expand = Callable[[IncludeAction], list[Any] | None]
"""The actions of an included launch file, or None to keep it as one."""


def collect_actions(actions: Iterable[Any], expand: Expand, steps: StepCounter) -> LaunchParts:
    """The parts of a list of actions.

    Args:
        actions: constructs.
        expand: is called for each included launch file.
        steps: counts actions and conditions.

    Raises:
        ScriptLimitError: there are too many.
    """
    collector = _Collector(expand, steps)
    collector.add_all(list(actions), _Group())
    return collector.parts


class _Collector:
    def __init__(self, expand: Expand, steps: StepCounter) -> None:
        self.parts = LaunchParts()
        self.expand = expand
        self.steps = steps
        self.level = 0
        self.included = 0

    def add_all(self, actions: list[Any], group: _Group) -> None:
        self.level += 1
        if self.level > MAX_LAUNCH_LEVELS:
            raise ScriptLimitError(f"actions nested more than {MAX_LAUNCH_LEVELS} times")
        for action in actions:
            self.steps.count()
            group = self.add(action, group)
        self.level -= 1

    def add(self, action: Any, group: _Group) -> _Group:
        """Add an action; returns what applies to the actions after it."""
        if isinstance(action, list | tuple):
            self.add_all(list(action), group)
        elif isinstance(action, Unknown):
            self.parts.ignored.append(action)
        elif isinstance(action, Construct) and self._condition_is_met(action):
            kind = action.short_name
            if kind == "SetRemap":
                return self._with_remapping(action, group)
            if kind == "PushRosNamespace":
                name = _text(action.get("namespace", 0), "")
                return replace(group, namespace=_join(group.namespace, name))
            add = _ACTIONS.get(kind)
            if add is not None:
                add(self, action, group)
            elif kind not in _IGNORED:
                self._leave_out(f"{kind} has no form in a spec", action)
        return group

    def _ignore(self, reason: str, action: Construct) -> None:
        self.parts.ignored.append(Note(reason, action.place))

    def _leave_out(self, reason: str, action: Construct) -> None:
        """Note an action that is not understood, and the module that would tell what it is."""
        self._ignore(reason, action)
        module = missing_module(action.name)
        if module:
            self.parts.missing.setdefault(module, []).append(action)

    def _condition_is_met(self, action: Construct) -> bool:
        decided = condition_value(action.get("condition"), self.steps)
        if decided is None:
            reason = f"the condition of {action.short_name} is not known, so it is left out"
            self._ignore(reason, action)
        return decided is True

    def _with_remapping(self, action: Construct, group: _Group) -> _Group:
        source, target = action.get("src", 0), action.get("dst", 1)
        if not isinstance(source, str) or not isinstance(target, str):
            self._ignore("a remapping that is not known", action)
            return group
        node, _, name = source.rpartition(":")
        remapping = Remapping(name, target, action.place, node)
        return replace(group, remappings=(*group.remappings, remapping))

    def group(self, action: Construct, group: _Group) -> None:
        self.add_all(_list(action.get("actions", 0)), group)

    def timer(self, action: Construct, group: _Group) -> None:
        self._ignore("the delay of a TimerAction is left out: readiness is observed", action)
        self.add_all(_list(action.get("actions")), group)

    def handler(self, action: Construct, _group: _Group) -> None:
        """An event handler: what it starts when another process starts, ends or prints."""
        event = action.get("event_handler", 0)
        if not isinstance(event, Construct):
            return
        for value in (*event.keywords.values(), *event.arguments):
            actions = value if isinstance(value, list | tuple) else [value]
            if any(isinstance(each, Construct) and each.short_name in _STARTS for each in actions):
                self._ignore("what an event handler starts is left out", action)
                return

    def description(self, action: Construct, group: _Group) -> None:
        self.add_all(_list(action.get("initial_entities", 0)), group)

    def node(self, action: Construct, group: _Group) -> None:
        executable = _text(action.get("executable"), "")
        if executable in _CONTAINER_EXECUTABLES:
            self.parts.containers[_text(action.get("name"), "container")] = executable
        elif self._is_known(action, "package", "executable"):
            node = self._node(action, group)
            node.executable = executable
            arguments = _list(action.get("arguments"))
            node.arguments = _texts(arguments)
            for _ in range(len(arguments) - len(node.arguments)):
                self._ignore("an argument is left out: its value is not known", action)
            self._append(self.parts.nodes, node)

    def process(self, action: Construct, _group: _Group) -> None:
        command = _texts(_list(action.get("cmd", 0)))
        name = _text(action.get("name"), command[0].rpartition("/")[2] if command else "process")
        self._append(self.parts.nodes, NodeAction(name, action, command=command))

    def container(self, action: Construct, group: _Group) -> None:
        name = _text(action.get("name"), "container")
        executable = _text(action.get("executable"), "component_container")
        if executable not in _CONTAINER_EXECUTABLES:
            self._ignore(f"{clip(executable)!r} is no known container", action)
            executable = "component_container_mt"
        self.parts.containers[name] = executable
        self._components(action.get("composable_node_descriptions"), group, name)

    def load(self, action: Construct, group: _Group) -> None:
        target = action.get("target_container", 1)
        name = target.get("name") if isinstance(target, Construct) else target
        container = _text(name, "container").rpartition("/")[2]
        self._components(action.get("composable_node_descriptions", 0), group, container)

    def _components(self, descriptions: Any, group: _Group, container: str) -> None:
        for action in _list(descriptions):
            if isinstance(action, Unknown):
                self.parts.ignored.append(action)
            if not isinstance(action, Construct) or not self._condition_is_met(action):
                continue
            if action.short_name != "ComposableNode":
                self._leave_out(f"the node that {action.short_name} makes is not known", action)
            elif self._is_known(action, "package", "plugin"):
                node = self._node(action, group)
                node.plugin, node.container = _text(action.get("plugin"), ""), container
                self._append(self.parts.nodes, node)

    def _append(self, members: list[Any], member: Member) -> None:
        members.append(member)
        if len(self.parts.nodes) + len(self.parts.includes) > MAX_LAUNCH_PARTS:
            raise ScriptLimitError(f"more than {MAX_LAUNCH_PARTS:,} nodes and included files")

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

    def _node(self, action: Construct, group: _Group) -> NodeAction:
        default = _text(action.get("plugin"), "").rpartition("::")[2]
        name = _text(action.get("name"), default or _text(action.get("executable"), "node"))
        own = []
        for pair in _list(action.get("remappings")):
            missing = unknown_in(pair)
            if missing is not None:
                reason = f"a remapping: {missing.reason}"
                self.parts.ignored.append(Note(reason, missing.place))
            # A text may be written as a list of parts, such as launch substitutions.
            names = [_text(part, "") for part in pair] if isinstance(pair, list | tuple) else []
            if len(names) == 2 and all(names):
                is_placed = isinstance(pair, PlacedTuple)
                place = pair.place if is_placed else action.place_of("remappings")
                own.append(Remapping(names[0], names[1], place))
        return NodeAction(
            name,
            action,
            package=_text(action.get("package"), ""),
            namespace=_absolute(_join(group.namespace, _text(action.get("namespace"), ""))),
            parameters=_list(action.get("parameters")),
            remappings=[*(each for each in group.remappings if each.node in {"", name}), *own],
        )

    def include(self, action: Construct, group: _Group) -> None:
        source = action.get("launch_description_source", 0)
        if isinstance(source, Construct):
            source = source.get("location", 0)
        path = _text(source, "")
        if not path:
            self._ignore("the file of an included launch file", action)
            return
        given = action.get("launch_arguments", default=[])
        pairs = list(given.items()) if isinstance(given, dict) else _list(given)
        include = IncludeAction(
            action,
            path=path,
            arguments={
                str(pair[0]): pair[1]
                for pair in pairs
                if isinstance(pair, list | tuple) and len(pair) == 2
            },
            namespace=_absolute(group.namespace),
            remappings=list(group.remappings),
        )
        if path.startswith("$(share ") and ")/" in path:
            inside = path.removeprefix("$(share ")
            include.path, (include.package, _, include.file) = "", inside.partition(")/")
        actions = self.expand(include) if self.included < MAX_LAUNCH_INCLUDES else None
        if actions is None:
            self._append(self.parts.includes, include)
            return
        self.included += 1
        self.add_all(actions, group)
        self.included -= 1


_ACTIONS: Final[dict[str, Callable[[_Collector, Construct, _Group], None]]] = {
    "GroupAction": _Collector.group,
    "TimerAction": _Collector.timer,
    "RegisterEventHandler": _Collector.handler,
    "LaunchDescription": _Collector.description,
    "Node": _Collector.node,
    "LifecycleNode": _Collector.node,
    "ExecuteProcess": _Collector.process,
    "ComposableNodeContainer": _Collector.container,
    "LoadComposableNodes": _Collector.load,
    "IncludeLaunchDescription": _Collector.include,
}
_STARTS: Final = frozenset(_ACTIONS) - {"RegisterEventHandler"}


def topic_in(namespace: str, topic: str) -> str:
    """The absolute name of a topic."""
    return topic if topic.startswith("/") else f"{namespace.rstrip('/')}/{topic}"


def _text(value: Any, default: str) -> str:
    if isinstance(value, list | tuple) and all(isinstance(part, str) for part in value):
        return "".join(value) or default
    return value if isinstance(value, str) and value else default


def _texts(values: list[Any]) -> list[str]:
    return [str(value) for value in values if isinstance(value, str | int | float)]


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
