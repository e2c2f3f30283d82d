"""One launch action as a node, a container or a program: every argument is kept, or noted.

What launch does around a process, such as starting it again when it has ended, is not what a run
does: that is noted as a change. Arguments that nothing here knows are noted as lost.

Namespaces, remappings, parameters and environment variables are also set by actions of their own,
for the actions after them and for what is in groups; a group ends what is set inside of it, unless
it is not scoped.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Final

from r2bspec.diagnostics.quote import clip
from r2bspec.interop.script_import.launch_parts import (
    ContainerAction,
    LaunchParts,
    NodeAction,
    ProcessSettings,
    Remapping,
)
from r2bspec.interop.script_import.launch_texts import parameter_value, performed
from r2bspec.interop.script_import.substitutions import split_words
from r2bspec.interop.script_import.values import (
    Construct,
    CopiedEnvironment,
    ImportNote,
    PlacedTuple,
    StepCounter,
    Unknown,
)
from r2bspec.plan.command_lines import THREADED_CONTAINER, flow_yaml

_CONTAINER_EXECUTABLES: Final = frozenset(
    {"component_container", "component_container_mt", "component_container_isolated"}
)
_ROS_ARGUMENTS: Final = "--ros-args"
_THREADS: Final = "thread_num"

_ENDING: Final = frozenset({"spawner", "unspawner", "spawn_entity.py", "create"})
"""Programs of ros2_control and Gazebo that prepare a simulation and end."""

_OUTPUT: Final = frozenset(
    {
        *("output", "output_format", "emulate_tty", "log_cmd", "cached_output", "exec_name"),
        *("sigterm_timeout", "sigkill_timeout", "respawn_delay", "respawn_max_retries"),
    }
)
"""Keywords about where output goes and how a process is ended, which a run decides itself."""
_PROCESS: Final = frozenset({"prefix", "env", "additional_env", "respawn", "on_exit", "condition"})
_ROS: Final = frozenset({"package", "name", "namespace", "parameters", "remappings"})
_KNOWN: Final = {
    "Node": _PROCESS | _OUTPUT | _ROS | {"executable", "arguments", "ros_arguments"},
    "ExecuteProcess": _PROCESS | _OUTPUT | {"cmd", "name", "shell"},
    "ComposableNode": _ROS | {"plugin", "extra_arguments", "condition"},
}
_KNOWN["LifecycleNode"] = _KNOWN["Node"] | {"autostart"}
_KNOWN["ComposableNodeContainer"] = _KNOWN["Node"] | {"composable_node_descriptions"}
_KNOWN["LifecycleComposableNode"] = _KNOWN["ComposableNode"] | {"autostart"}


class NodeReader:
    """Reads actions that start one node or process.

    Args:
        parts: gets the notes.
        steps: counts the steps.
    """

    def __init__(self, parts: LaunchParts, steps: StepCounter) -> None:
        self.parts = parts
        self.steps = steps

    def lose(self, reason: str, action: Construct) -> None:
        """Note something that a node would need and the file does not tell."""
        self.parts.ignored.append(ImportNote(reason, action.place))

    def change(self, what: str, action: Construct) -> None:
        """Note something that a run does in another way."""
        self.parts.changes.append(ImportNote(what, action.place))

    def text(self, action: Construct, key: str) -> str:
        """A keyword argument that is a text; empty, with a note, where it is not known."""
        value = action.get(key)
        if value is None:
            return ""
        text = performed(value, action, self.steps)
        if isinstance(text, Unknown):
            what = f"the {key} of {action.short_name} is not known: {text.reason}"
            self.parts.ignored.append(ImportNote(what, text.place))
            return ""
        return str(text)

    def texts(self, action: Construct, key: str, position: int | None = None) -> list[str]:
        """A keyword argument that is a list of texts, each of which may be written in parts."""
        words = []
        for value in listed(action.get(key, position)):
            text = performed(value, action, self.steps)
            if isinstance(text, Unknown):
                what = f"an argument of {action.short_name} is not known: {text.reason}"
                self.parts.ignored.append(ImportNote(what, text.place))
            else:
                words.append(str(text))
        return words

    def executable(self, action: Construct, scope: Scope) -> NodeAction | None:
        """A program of a package; None, with a note, where it is not known which."""
        if not self.is_known(action, "package", "executable"):
            return None
        node = self._node(action, scope)
        node.executable = self.text(action, "executable")
        node.arguments = self._arguments(action)
        node.process = self._process(action, scope)
        if action.get("name") is None:
            self.change(
                f"the file gives {node.executable!r} no name, so its nodes keep those of their "
                "code; here it is the key of the node, by which parameter files must name it",
                action,
            )
        if node.executable in _ENDING:
            self.change(
                f"{node.executable!r} ends when it has done its work, and a run fails when a "
                "process ends: write it as a step of 'after_ready'",
                action,
            )
        node.lifecycle = "active" if self._is_set(action, "autostart") else ""
        return node

    def component(self, action: Construct, scope: Scope, container: str) -> NodeAction | None:
        """A plugin; None, with a note, where it is not known which."""
        if not self.is_known(action, "package", "plugin"):
            return None
        node = self._node(action, scope)
        node.plugin, node.container = self.text(action, "plugin"), container
        for extra in listed(action.get("extra_arguments")):
            values = parameter_value(extra, action, self.steps)
            if not isinstance(values, dict):
                self.lose("an extra argument that is no map", action)
                continue
            for name, value in values.items():
                if name == "use_intra_process_comms" and isinstance(value, bool):
                    node.intra_process = value
                else:
                    node.extra_arguments[str(name)] = value
        node.lifecycle = "active" if self._is_set(action, "autostart") else ""
        return node

    def program(self, action: Construct, scope: Scope) -> NodeAction | None:
        """Any program; None, with a note, where its command line is not known."""
        self._check_keywords(action)
        command = self.texts(action, "cmd", 0)
        if not command:
            self.lose(f"the command line of {action.short_name} is not known", action)
            return None
        if action.get("shell") not in {None, False}:
            command = ["sh", "-c", " ".join(command)]
        name = self.text(action, "name") or command[0].rpartition("/")[2] or "process"
        process = self._process(action, scope)
        return NodeAction(name, action, command=command, process=process)

    def container(self, action: Construct, scope: Scope) -> ContainerAction:
        """A component container; its parameters and remappings are arguments of its program."""
        self._check_keywords(action)
        name = self.text(action, "name") or "container"
        namespace = join_namespaces(scope.namespace, self.text(action, "namespace"))
        executable = self.text(action, "executable") or "component_container"
        if executable not in _CONTAINER_EXECUTABLES:
            self.lose(f"{clip(executable)!r} is no known container", action)
            executable = "component_container_mt"
        container = ContainerAction(action, name, absolute(namespace) + f"/{name}", executable)
        container.process = self._process(action, scope)
        words = self._arguments(action)
        container.is_multi_threaded = THREADED_CONTAINER in words
        words = [word for word in words if word != THREADED_CONTAINER]
        for source in self._parameters(action, scope):
            words += self._container_parameters(container, source)
        for remapping in self._remappings(action, scope, name):
            words += [_ROS_ARGUMENTS, "-r", f"{remapping.source}:={remapping.target}"]
        container.arguments = words
        return container

    def is_container(self, action: Construct) -> bool:
        """Whether a node is a container of rclcpp."""
        return performed(action.get("executable"), action, self.steps) in _CONTAINER_EXECUTABLES

    def is_known(self, action: Construct, *keys: str) -> bool:
        """Whether the file tells what is started: a node without that has no form in a spec."""
        self._check_keywords(action)
        for key in keys:
            value = performed(action.get(key), action, self.steps)
            if isinstance(value, Unknown) or not value:
                known = isinstance(value, Unknown) and action.get(key) is not None
                why = value.reason if known else f"its {key} is not known"
                self.lose(f"{action.short_name} is left out: {why}", action)
                return False
        return True

    def _check_keywords(self, action: Construct) -> None:
        known = _KNOWN.get(action.short_name, _KNOWN["Node"])
        for key, value in action.keywords.items():
            if key not in known and value is not None:
                self.lose(f"{clip(key)!r} of {action.short_name} has no form in a spec", action)

    def _node(self, action: Construct, scope: Scope) -> NodeAction:
        plugin, executable = self.text(action, "plugin"), self.text(action, "executable")
        name = self.text(action, "name") or plugin.rpartition("::")[2] or executable
        return NodeAction(
            name,
            action,
            package=self.text(action, "package"),
            namespace=absolute(join_namespaces(scope.namespace, self.text(action, "namespace"))),
            parameters=self._parameters(action, scope),
            remappings=self._remappings(action, scope, name),
        )

    def _arguments(self, action: Construct) -> list[str]:
        ros = self.texts(action, "ros_arguments")
        return [*self.texts(action, "arguments"), *([_ROS_ARGUMENTS, *ros] if ros else [])]

    def _process(self, action: Construct, scope: Scope) -> ProcessSettings:
        environment = dict(scope.environment)
        for key in ("env", "additional_env"):
            given = action.get(key)
            values = list(given.items()) if isinstance(given, dict) else listed(given)
            for pair in values:
                if not isinstance(pair, list | tuple) or len(pair) != 2:
                    self.lose("an environment variable is not known", action)
                    continue
                name, value = (performed(part, action, self.steps) for part in pair)
                environment[str(name)] = value if isinstance(value, Unknown) else str(value)
            if key == "env" and values and not isinstance(given, CopiedEnvironment):
                self.change("'env' of launch has no other variables; here they are added", action)
        if self._is_set(action, "respawn"):
            self.change("'respawn' is left out: a run fails when a process ends", action)
        if not all(map(is_quiet, listed(action.get("on_exit")))):
            self.lose("what is started when another process has ended", action)
        elif action.get("on_exit") is not None:
            self.change("what 'on_exit' does is left out: a run fails when a process ends", action)
        prefix = self.text(action, "prefix")
        return ProcessSettings(environment, tuple(split_words(prefix)))

    def _is_set(self, action: Construct, key: str) -> bool:
        value = action.get(key)
        if value is None or value is False:
            return False
        return str(performed(value, action, self.steps)).lower() not in {"false", "0"}

    def _parameters(self, action: Construct, scope: Scope) -> list[Any]:
        own = [self._source(source, action) for source in listed(action.get("parameters"))]
        return [*scope.parameters, *own]

    def _source(self, source: Any, action: Construct) -> Any:
        """A map, the path of a file, or something unknown."""
        if isinstance(source, dict):
            return parameter_value(source, action, self.steps)
        kind = source.short_name if isinstance(source, Construct) else ""
        if kind == "Parameter" and isinstance(source, Construct):
            name = performed(source.get("name", 0), action, self.steps)
            value = parameter_value(source.get("value", 1), action, self.steps)
            return {name: value} if isinstance(name, str) else name
        if kind == "ParameterFile" and isinstance(source, Construct):
            if source.get("allow_substs", 1, False) is not False:
                reason = "substitutions in a parameter file are made when it is launched"
                return Unknown(reason, source.place)
            return self._source(source.get("param_file", 0), action)
        return performed(source, action, self.steps)

    def _container_parameters(self, container: ContainerAction, source: Any) -> list[str]:
        if isinstance(source, str):
            return [_ROS_ARGUMENTS, "--params-file", source]
        words = []
        for name, value in source.items() if isinstance(source, dict) else [("", source)]:
            is_number = isinstance(value, int) and not isinstance(value, bool)
            if name == _THREADS and is_number:
                container.threads = value
            elif isinstance(value, bool | int | float | str | list) and name:
                words += [_ROS_ARGUMENTS, "-p", f"{name}:={flow_yaml(value)}"]
            else:
                self.lose("a parameter of a container is not known", container.source)
        return words

    def _remappings(self, action: Construct, scope: Scope, name: str) -> list[Remapping]:
        """Remappings that a group sets come first."""
        own = []
        for pair in listed(action.get("remappings")):
            if isinstance(pair, list | tuple) and len(pair) == 2:
                names = [performed(part, action, self.steps) for part in pair]
            else:
                is_known = not isinstance(pair, Unknown)
                names = [Unknown("it is no pair", action.place) if is_known else pair]
            lost = next((part for part in names if isinstance(part, Unknown)), None)
            if lost is not None:
                self.parts.ignored.append(ImportNote(f"a remapping: {lost.reason}", lost.place))
            elif all(names):
                default = action.place_of("remappings")
                place = pair.place if isinstance(pair, PlacedTuple) else default
                own.append(Remapping(str(names[0]), str(names[1]), place))
        return [
            *(remapping for remapping in scope.remappings if remapping.node in {"", name}),
            *own,
        ]


def listed(value: Any) -> list[Any]:
    """A value as a list: what stands alone is one item, and None is none."""
    if isinstance(value, list | tuple):
        return list(value)
    return [] if value is None else [value]


def changed_state(value: Any) -> Construct | None:
    """The event of an action that changes the state of a lifecycle node; None for any other."""
    is_event = isinstance(value, Construct) and value.short_name == "EmitEvent"
    event = value.get("event", 0) if is_event else None
    is_change = isinstance(event, Construct) and event.short_name == "ChangeState"
    return event if is_change else None


def is_quiet(value: Any) -> bool:
    """Whether an action only prints, or ends the launch."""
    if not isinstance(value, Construct):
        return False
    if value.short_name == "EmitEvent":
        event = value.get("event", 0)
        return isinstance(event, Construct) and event.short_name == "Shutdown"
    return value.short_name in {"LogInfo", "Shutdown"}


def absolute(namespace: str) -> str:
    """A namespace with its slash; empty for the root."""
    return f"/{namespace.strip('/')}" if namespace.strip("/") else ""


@dataclass(frozen=True, slots=True)
class Scope:
    """What applies to the next action.

    Attributes:
        namespace: of the groups; empty for none.
        parameters: maps and paths of files, which a node gets before its own.
        arguments: the values of launch arguments, which an included file gets and changes.
    """

    namespace: str = ""
    remappings: tuple[Remapping, ...] = ()
    parameters: tuple[Any, ...] = ()
    environment: dict[str, Any] = field(default_factory=dict)
    arguments: Mapping[str, Any] = field(default_factory=dict)


_TEXTS: Final = {
    "PushRosNamespace": ("namespace",),
    "PushROSNamespace": ("namespace",),
    "SetRemap": ("src", "dst"),
    "SetParametersFromFile": ("filename",),
    "SetEnvironmentVariable": ("name", "value"),
    "SetROSLogDir": ("new_log_dir",),
    "SetParameter": ("name",),
    "SetUseSimTime": (),
}
"""The actions that change the scope, and their arguments that are texts, by position."""


def changed_scope(action: Construct, scope: Scope, steps: StepCounter) -> Scope | Unknown | None:
    """The scope after an action; None for an action that changes none, or why it is not known."""
    kind = action.short_name
    if kind not in _TEXTS:
        return None
    values = [
        performed(action.get(key, position, "" if key == "namespace" else None), action, steps)
        for position, key in enumerate(_TEXTS[kind])
    ]
    if kind in {"SetParameter", "SetUseSimTime"}:
        values.append(parameter_value(action.get("value", len(values)), action, steps))
    if kind == "SetParametersFromFile" and action.keywords.keys() - {"filename", "condition"}:
        values.append(Unknown("it is for some nodes", action.place))
    unknown = next((value for value in values if isinstance(value, Unknown)), None)
    if unknown is not None:
        return unknown
    match kind, values:
        case "SetRemap", [source, target]:
            node, _, name = source.rpartition(":")
            remapping = Remapping(name, target, action.place, node)
            return replace(scope, remappings=(*scope.remappings, remapping))
        case "SetParameter", [name, value]:
            return replace(scope, parameters=(*scope.parameters, {name: value}))
        case "SetUseSimTime", [value]:
            return replace(scope, parameters=(*scope.parameters, {"use_sim_time": value}))
        case "SetParametersFromFile", [file]:
            return replace(scope, parameters=(*scope.parameters, file))
        case "SetEnvironmentVariable", [name, value]:
            return replace(scope, environment={**scope.environment, name: str(value)})
        case "SetROSLogDir", [folder]:
            return replace(scope, environment={**scope.environment, "ROS_LOG_DIR": str(folder)})
    return replace(scope, namespace=join_namespaces(scope.namespace, str(values[0])))


def join_namespaces(above: str, namespace: str) -> str:
    """A namespace inside of another one."""
    if namespace.startswith("/") or not above:
        return namespace
    return f"{above.rstrip('/')}/{namespace}" if namespace else above
