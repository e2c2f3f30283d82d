"""What recorded launch actions start: nodes, components, containers, programs, included files.

Actions are performed in order, as launch does: launch arguments get their values, functions are
called, groups pass on their namespace, remappings, parameters and environment, and included files
in Python are executed. What launch does around a process, such as starting it again, is noted as a
change; what has no form in a spec, as lost.
"""

from __future__ import annotations

import shlex
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Final

from r2bspec.interop.launch_texts import CONFIGURATIONS, evaluate, perform
from r2bspec.interop.recording import ContainerAction, IncludeAction, NodeAction, NoteKind
from r2bspec.interop.stand_ins import CopiedEnvironment, Recorded, Recording

_CONTAINERS: Final = frozenset(
    {"component_container", "component_container_mt", "component_container_isolated"}
)
_KEYWORDS: Final = frozenset(
    {
        *("package", "executable", "plugin", "name", "namespace", "parameters", "remappings"),
        *("arguments", "ros_arguments", "extra_arguments", "composable_node_descriptions"),
        *("cmd", "shell", "prefix", "env", "additional_env", "autostart", "condition"),
        # Of these, a run decides itself: where output goes, and how a process is ended.
        *("output", "output_format", "emulate_tty", "log_cmd", "cached_output", "exec_name"),
        *("sigterm_timeout", "sigkill_timeout", "respawn_delay", "respawn_max_retries"),
        *("respawn", "on_exit"),
    }
)
"""The keywords of processes and components that are read, or that are no matter of a spec."""
_NOTHING: Final = frozenset({"LogInfo", "Log", "ReadyToTest", "Shutdown"})


@dataclass(frozen=True, slots=True)
class _Scope:
    """What applies to the next action."""

    namespace: str = ""
    remappings: tuple[tuple[str, str, str], ...] = ()
    parameters: tuple[Any, ...] = ()
    environment: dict[str, str] = field(default_factory=dict)


class LaunchRecorder:
    """Performs recorded actions.

    Attributes:
        nodes, containers, includes: what the actions start.
        arguments: default values of the launch arguments, by name; None without one.
    """

    def __init__(self, recording: Recording) -> None:
        self.recording = recording
        self.nodes: list[NodeAction] = []
        self.containers: list[ContainerAction] = []
        self.includes: list[IncludeAction] = []
        self.arguments: dict[str, str | None] = {}
        self._made: list[tuple[Recorded, ContainerAction]] = []
        self._targets: list[tuple[NodeAction, Any]] = []

    def perform_all(self, actions: Any) -> None:
        """Perform the actions of a file."""
        self._visit_all(actions, _Scope())
        self._place_components()

    def _visit_all(self, actions: Any, scope: _Scope) -> _Scope:
        for action in listed(actions):
            scope = self._visit(action, scope)
        return scope

    def _visit(self, action: Any, scope: _Scope) -> _Scope:
        if isinstance(action, list | tuple):
            return self._visit_all(action, scope)
        if not isinstance(action, Recorded):
            if action is not None:
                self.recording.note("lost", f"{type(action).__name__} is no launch action")
            return scope
        if action._kind in _NOTHING or not evaluate(action._get("condition")):
            return scope
        perform_action = _ACTIONS.get(action._kind)
        if perform_action is None:
            self._not_known(action, "has no form in a spec")
            return scope
        return perform_action(self, action, scope) or scope

    def _lose(self, reason: str, action: Recorded) -> None:
        self.recording.note("lost", reason, action._place)

    def _change(self, what: str, action: Recorded) -> None:
        self.recording.note("changed", what, action._place)

    def _not_known(self, action: Recorded, why: str) -> None:
        """Note an action that is not understood: its module may be missing."""
        known = action._name.partition(".")[0] in {"launch", "launch_ros", "launch_testing"}
        kind: NoteKind = "lost" if known else "missing"
        self.recording.note(kind, f"{action._name} {why}", action._place)

    def _declare(self, action: Recorded, _: _Scope) -> None:
        name, default = perform(action._get("name", 0)), action._get("default_value", 1)
        text = None if default is None else perform(default)
        self.arguments.setdefault(name, text)
        if text is not None:
            CONFIGURATIONS.setdefault(name, text)
        choices = [perform(choice) for choice in listed(action._get("choices"))]
        value = CONFIGURATIONS.get(name)
        if choices and value is not None and value not in choices:
            shown = ", ".join(choices)
            self._lose(f"{value!r} is no choice of the launch argument {name!r}: {shown}", action)

    def _configure(self, action: Recorded, _: _Scope) -> None:
        CONFIGURATIONS[perform(action._get("name", 0))] = perform(action._get("value", 1))

    def _group(self, action: Recorded, scope: _Scope) -> _Scope:
        before = dict(CONFIGURATIONS)
        given = action._get("launch_configurations") or {}
        CONFIGURATIONS.update({perform(name): perform(value) for name, value in given.items()})
        inside = self._visit_all(action._get("actions", 0), scope)
        if action._get("scoped") is False:
            return inside
        CONFIGURATIONS.clear()
        CONFIGURATIONS.update(before)
        return scope

    def _opaque(self, action: Recorded, scope: _Scope) -> _Scope:
        function = action._get("function", 0)
        context = Recorded(
            "launch.LaunchContext", kwargs={"launch_configurations": CONFIGURATIONS}, called=True
        )
        args, keywords = action._get("args", 1) or (), action._get("kwargs", 2) or {}
        return self._visit_all(function(context, *args, **keywords), scope)

    def _timer(self, action: Recorded, scope: _Scope) -> _Scope:
        self._change("the delay of a TimerAction is left out: readiness is observed", action)
        return self._visit_all(action._get("actions"), scope)

    def _event(self, action: Recorded, _: _Scope) -> None:
        """Note what an event handler starts, or what happens at an event."""
        event = action._get("event_handler", 0, action._get("event"))
        keywords = event._kwargs if isinstance(event, Recorded) else {}
        starts = [*listed(keywords.get("entities")), *listed(keywords.get("on_exit"))]
        if _is_quiet(event) or (starts and all(map(_is_quiet, starts))):
            self._change("what happens at an event is left out: it starts nothing", action)
        else:
            self._lose("what happens at an event is left out", action)

    def _description(self, action: Recorded, scope: _Scope) -> _Scope:
        scope = self._visit_all(action._get("initial_entities", 0), scope)
        return self._visit_all(action._kwargs.get("added"), scope)

    def _set(self, action: Recorded, scope: _Scope) -> _Scope:
        """Change what applies to the actions after this."""
        name, value = perform(action._get("name", 0)), action._get("value", 1)
        match action._kind:
            case "PushRosNamespace" | "PushROSNamespace":
                namespace = perform(action._get("namespace", 0))
                return replace(scope, namespace=_joined(scope.namespace, namespace))
            case "SetRemap":
                node, _, source = perform(action._get("src", 0)).rpartition(":")
                rule = (node, source, perform(action._get("dst", 1)))
                return replace(scope, remappings=(*scope.remappings, rule))
            case "SetParameter":
                given = {name: parameter_value(value)}
                return replace(scope, parameters=(*scope.parameters, given))
        return replace(scope, environment=scope.environment | {name: perform(value)})

    def _node(self, action: Recorded, scope: _Scope) -> None:
        executable = perform(action._get("executable"))
        if executable in _CONTAINERS:
            self._container(action, scope)
            return
        described = self._described(action, scope) | self._process(action, scope)
        arguments = self._arguments(action)
        node = NodeAction(**described, executable=executable, arguments=arguments)
        if not node.package or not executable:
            self._lose(f"{action._kind} has no package or no executable", action)
        if action._get("name") is None:
            self._change(
                f"the file gives {executable!r} no name, so its nodes keep those of their code; "
                "here it is the key of the node, by which parameter files must name it",
                action,
            )
        self._add(action, node)

    def _add(self, action: Recorded, node: NodeAction) -> None:
        is_autostarted = perform(action._get("autostart")).lower() in {"true", "1"}
        node.lifecycle = "active" if is_autostarted else ""
        self.nodes.append(node)

    def _program(self, action: Recorded, scope: _Scope) -> None:
        command = [perform(word) for word in listed(action._get("cmd", 0))]
        if not command:
            self._lose(f"the command line of {action._kind} is not known", action)
            return
        if action._get("shell") not in {None, False}:
            command = ["sh", "-c", " ".join(command)]
        name = perform(action._get("name")) or command[0].rpartition("/")[2] or "process"
        process = self._process(action, scope)
        self.nodes.append(NodeAction(name=name, place=action._place, command=command, **process))

    def _composed(self, action: Recorded, scope: _Scope) -> None:
        container = self._container(action, scope)
        descriptions = action._get("composable_node_descriptions")
        self._components(descriptions, scope, container.name, action)

    def _container(self, action: Recorded, scope: _Scope) -> ContainerAction:
        described = self._described(action, scope)
        name = perform(action._get("name")) or "container"
        executable = perform(action._get("executable")) or "component_container"
        if executable not in _CONTAINERS:
            self._lose(f"{executable!r} is no known container", action)
            executable = "component_container_mt"
        full = f"{described['namespace']}/{name}"
        if any(container.name == name for container in self.containers):
            name = full.strip("/").replace("/", "_")
        container = ContainerAction(
            name=name,
            full_name=full,
            executable=executable,
            place=action._place,
            arguments=self._arguments(action),
            parameters=described["parameters"],
            remappings=described["remappings"],
            **self._process(action, scope),
        )
        self.containers.append(container)
        self._made.append((action, container))
        return container

    def _load(self, action: Recorded, scope: _Scope) -> None:
        target = action._get("target_container", 1)
        if not (isinstance(target, Recorded) and "executable" in target._kwargs):
            target = perform(target)
        self._components(action._get("composable_node_descriptions", 0), scope, "", target)

    def _components(self, actions: Any, scope: _Scope, container: str, target: Any) -> None:
        for action in listed(actions):
            if not isinstance(action, Recorded) or not evaluate(action._get("condition")):
                continue
            if not action._kind.endswith("ComposableNode"):
                self._not_known(action, "makes a node that is not known")
                continue
            described, plugin = self._described(action, scope), perform(action._get("plugin"))
            node = NodeAction(**described, plugin=plugin, container=container)
            for extra in listed(action._get("extra_arguments")):
                node.extra_arguments |= parameter_value(extra)
            self._add(action, node)
            if not container:
                self._targets.append((node, target))

    def _place_components(self) -> None:
        """Give the components that are loaded into another container the name of that one."""
        for node, target in self._targets:
            named = target if isinstance(target, str) else perform(target._get("name"))
            last, full = named.rpartition("/")[2], f"/{named.strip('/')}"
            same = [made for source, made in self._made if source is target]
            same = same or [each for each in self.containers if each.full_name == full]
            if not same:
                ends = [each for each in self.containers if each.full_name.endswith(f"/{last}")]
                same += ends if len(ends) == 1 else []
            node.container = same[0].name if same else last
            if not same:
                what = f"the container {last!r} is started elsewhere; here it is one of the spec"
                self.recording.note("changed", what, node.place)

    def _described(self, action: Recorded, scope: _Scope) -> dict[str, Any]:
        """Return what nodes and containers have."""
        plugin, executable = perform(action._get("plugin")), perform(action._get("executable"))
        namespace = _joined(scope.namespace, perform(action._get("namespace")))
        name = perform(action._get("name")) or plugin.rpartition("::")[2] or executable
        remappings = [(old, new) for node, old, new in scope.remappings if node in {"", name}]
        for pair in listed(action._get("remappings")):
            if isinstance(pair, Recorded):
                self._lose(f"{pair._what()}, a remapping, is not known", action)
            elif all(names := (perform(pair[0]), perform(pair[1]))):
                remappings.append(names)
        self._check_keywords(action)
        return {
            "name": name,
            "place": action._place,
            "package": perform(action._get("package")),
            "namespace": _absolute(namespace),
            "parameters": [*scope.parameters, *map(_source, listed(action._get("parameters")))],
            "remappings": remappings,
        }

    def _check_keywords(self, action: Recorded) -> None:
        for key, value in action._kwargs.items():
            if key not in _KEYWORDS and value is not None:
                self._lose(f"{key!r} of {action._kind} has no form in a spec", action)

    def _arguments(self, action: Recorded) -> list[str]:
        ros = [perform(word) for word in listed(action._get("ros_arguments"))]
        words = [perform(word) for word in listed(action._get("arguments"))]
        return [*words, *(["--ros-args", *ros] if ros else [])]

    def _process(self, action: Recorded, scope: _Scope) -> dict[str, Any]:
        """Return what all processes have."""
        self._check_keywords(action)
        environment = dict(scope.environment)
        for key in ("env", "additional_env"):
            given = action._get(key)
            if given is None:
                continue
            if key == "env" and not isinstance(given, CopiedEnvironment):
                self._change("'env' of launch has no other variables; here they are added", action)
            for pair in given.items() if isinstance(given, dict) else listed(given):
                if isinstance(pair, Recorded):
                    self._lose(f"{pair._what()}, an environment, is not known", action)
                else:
                    environment[perform(pair[0])] = perform(pair[1])
        if perform(action._get("respawn")).lower() in {"true", "1"}:
            self._change("'respawn' is left out: a run fails when a process ends", action)
        ends = listed(action._get("on_exit"))
        if not all(map(_is_quiet, ends)):
            self._lose("what is started when another process has ended", action)
        elif ends:
            self._change("what 'on_exit' does is left out: a run fails when a process ends", action)
        prefix = perform(action._get("prefix"))
        return {"environment": environment, "prefix": shlex.split(prefix)}

    def _include(self, action: Recorded, scope: _Scope) -> _Scope | None:
        source = action._get("launch_description_source", 0)
        if isinstance(source, Recorded) and source._kind.endswith("LaunchDescriptionSource"):
            source = source._get("location", 0, source._get("launch_file_path"))
        path, given = perform(source), action._get("launch_arguments", 1) or []
        pairs = list(given.items()) if isinstance(given, dict) else listed(given)
        CONFIGURATIONS.update({perform(pair[0]): perform(pair[1]) for pair in pairs})
        if path.endswith(".py") and Path(path).is_file():
            name = f"included_{len(self.recording.trees)}"
            module = self.recording.execute(Path(path), name)
            return self._visit_all(module.generate_launch_description(), scope)
        if scope.parameters:
            self._lose("parameters that are set for an included launch file", action)
        self.includes.append(
            IncludeAction(
                place=action._place,
                path=path,
                arguments=dict(CONFIGURATIONS),
                namespace=_absolute(scope.namespace),
                remappings=[(old, new) for _, old, new in scope.remappings],
                environment=scope.environment,
            )
        )
        return None


_ACTIONS: Final[dict[str, Callable[[LaunchRecorder, Recorded, _Scope], _Scope | None]]] = {
    "DeclareLaunchArgument": LaunchRecorder._declare,
    "SetLaunchConfiguration": LaunchRecorder._configure,
    "GroupAction": LaunchRecorder._group,
    "OpaqueFunction": LaunchRecorder._opaque,
    "TimerAction": LaunchRecorder._timer,
    "RegisterEventHandler": LaunchRecorder._event,
    "EmitEvent": LaunchRecorder._event,
    "LaunchDescription": LaunchRecorder._description,
    "PushRosNamespace": LaunchRecorder._set,
    "PushROSNamespace": LaunchRecorder._set,
    "SetRemap": LaunchRecorder._set,
    "SetParameter": LaunchRecorder._set,
    "SetEnvironmentVariable": LaunchRecorder._set,
    "Node": LaunchRecorder._node,
    "LifecycleNode": LaunchRecorder._node,
    "ExecuteProcess": LaunchRecorder._program,
    "ExecuteLocal": LaunchRecorder._program,
    "ComposableNodeContainer": LaunchRecorder._composed,
    "LoadComposableNodes": LaunchRecorder._load,
    "IncludeLaunchDescription": LaunchRecorder._include,
}


def parameter_value(value: Any) -> Any:
    """Return the value of a parameter: the result of a substitution is read as YAML."""
    import yaml

    if isinstance(value, dict):
        return {perform(name): parameter_value(item) for name, item in value.items()}
    is_text_in_parts = isinstance(value, list | tuple) and any(
        isinstance(part, Recorded) for part in value
    )
    if isinstance(value, Recorded) and value._kind == "ParameterValue":
        inner = value._get("value", 0)
        is_text = value._get("value_type", 1) is str
        return perform(inner) if is_text else parameter_value(inner)
    if isinstance(value, Recorded) or is_text_in_parts:
        text = perform(value)
        try:
            return text if "$(" in text else yaml.safe_load(text)
        except yaml.YAMLError:
            return text
    if isinstance(value, list | tuple):
        items = [parameter_value(item) for item in value]
        # As launch does, integers among doubles become doubles.
        is_mixed = {type(item) for item in items} == {int, float}
        return [float(item) for item in items] if is_mixed else items
    return value if isinstance(value, bool | int | float | str) else perform(value)


def _source(source: Any) -> Any:
    """Return a map of parameters, or the path of a file."""
    if isinstance(source, dict):
        return parameter_value(source)
    if isinstance(source, Recorded) and source._kind == "Parameter":
        return {perform(source._get("name", 0)): parameter_value(source._get("value", 1))}
    if isinstance(source, Recorded) and source._kind == "ParameterFile":
        return perform(source._get("param_file", 0))
    return perform(source)


def listed(value: Any) -> list[Any]:
    """Return a value as a list: a single value is one item, and None is empty."""
    if isinstance(value, Recorded | str | dict):
        return [value]
    return [] if value is None else list(value) if isinstance(value, Iterable) else [value]


def _is_quiet(action: Any) -> bool:
    """Return whether an action only prints, or ends the launch."""
    if isinstance(action, Recorded) and action._kind == "EmitEvent":
        action = action._get("event", 0)
    return isinstance(action, Recorded) and action._kind in _NOTHING


def _absolute(namespace: str) -> str:
    """Return a namespace with its slash; empty for the root."""
    return f"/{namespace.strip('/')}" if namespace.strip("/") else ""


def _joined(above: str, namespace: str) -> str:
    """Return a namespace inside of another one."""
    if namespace.startswith("/") or not above:
        return namespace
    return f"{above.rstrip('/')}/{namespace}" if namespace else above
