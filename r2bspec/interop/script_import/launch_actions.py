"""The nodes, containers and included launch files of a list of launch actions.

Actions are the constructs that a script or a launch file returns. Groups pass their namespace,
remappings, parameters and environment to what is in them, as `launch_ros` does. What is started
under a condition that is not known is left out with a note, and so is whatever else the file does
not tell or a spec has no key for; what a run does in another way is noted as a change.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from typing import Any, Final

from r2bspec.interop.script_import.launch_files import LaunchFile
from r2bspec.interop.script_import.launch_nodes import (
    NodeReader,
    Scope,
    absolute,
    changed_scope,
    changed_state,
    is_quiet,
    listed,
)
from r2bspec.interop.script_import.launch_parts import (
    ContainerAction,
    IncludeAction,
    LaunchParts,
    Member,
    NodeAction,
)
from r2bspec.interop.script_import.launch_texts import condition_value, performed
from r2bspec.interop.script_import.source_files import missing_module
from r2bspec.interop.script_import.spec_text import identifier
from r2bspec.interop.script_import.values import (
    Construct,
    Foreign,
    ImportNote,
    ScriptLimitError,
    StepCounter,
    Unknown,
)
from r2bspec.safe_io.limits import MAX_LAUNCH_INCLUDES, MAX_LAUNCH_LEVELS, MAX_LAUNCH_PARTS

_IGNORED: Final = frozenset(
    {"DeclareLaunchArgument", "SetLaunchConfiguration", "LogInfo", "ReadyToTest", "Shutdown"}
)
"""Actions that start nothing; launch arguments are evaluated before (`launch_files`)."""

_STATES: Final = {"configure": "inactive", "1": "inactive", "activate": "active", "3": "active"}
"""What a transition of lifecycle_msgs leads to, by its name or number."""

Expand = Callable[[IncludeAction, Mapping[str, Any]], LaunchFile | None]
"""What an included launch file does, or None to keep it as one; gets the launch arguments."""


def collect_actions(
    actions: Iterable[Any],
    expand: Expand,
    steps: StepCounter,
    arguments: Mapping[str, Any] | None = None,
) -> LaunchParts:
    """The parts of a list of actions.

    Args:
        actions: constructs.
        expand: is called for each included launch file.
        steps: counts actions and conditions.
        arguments: the values of launch arguments with which the actions were evaluated.

    Raises:
        ScriptLimitError: there are too many.
    """
    collector = _Collector(expand, steps, arguments or {})
    collector.add_all(list(actions), Scope(arguments=collector.arguments))
    collector.place_components()
    collector.change_states()
    return collector.parts


class _Collector:
    def __init__(self, expand: Expand, steps: StepCounter, arguments: Mapping[str, Any]) -> None:
        self.parts = LaunchParts()
        self.arguments = arguments
        self.expand = expand
        self.steps = steps
        self.reader = NodeReader(self.parts, steps)
        self.targets: list[tuple[NodeAction, Any]] = []
        self.transitions: list[tuple[Construct, Any, str]] = []
        self.level = 0
        self.included = 0

    def add_all(self, actions: list[Any], scope: Scope) -> Scope:
        """Add actions in order; returns what applies to the actions after them."""
        self.level += 1
        if self.level > MAX_LAUNCH_LEVELS:
            raise ScriptLimitError(f"actions nested more than {MAX_LAUNCH_LEVELS} times")
        for action in actions:
            self.steps.count()
            scope = self.add(action, scope)
        self.level -= 1
        return scope

    def add(self, action: Any, scope: Scope) -> Scope:
        """Add an action; returns what applies to the actions after it."""
        if isinstance(action, list | tuple):
            return self.add_all(list(action), scope)
        if isinstance(action, Unknown):
            self.parts.ignored.append(action)
        if not isinstance(action, Construct) or action.short_name in _IGNORED:
            return scope
        self._check_arguments(action, scope)
        if not self._condition_is_met(action):
            return scope
        changed = changed_scope(action, scope, self.steps)
        if isinstance(changed, Unknown):
            reason = f"what {action.short_name} sets is not known: {changed.reason}"
            self.parts.ignored.append(ImportNote(reason, changed.place))
        elif changed is not None:
            return changed
        elif (add := _ACTIONS.get(action.short_name)) is not None:
            return add(self, action, scope) or scope
        else:
            self._leave_out(f"{action.short_name} has no form in a spec", action)
        return scope

    def _check_arguments(self, action: Construct, scope: Scope) -> None:
        """Launch arguments of an included file apply to the actions after it, in the same group."""
        if scope.arguments is self.arguments:
            return
        self.steps.count_items(self.arguments)
        for name, value in self.arguments.items():
            if scope.arguments.get(name, value) != value:
                reason = f"the launch argument {name!r} has the value of an included file here"
                self.reader.lose(reason, action)

    def _leave_out(self, reason: str, action: Construct) -> None:
        """Note an action that is not understood, and the module that would tell what it is."""
        self.reader.lose(reason, action)
        module = missing_module(action.name)
        if module:
            self.parts.missing.setdefault(module, []).append(action)

    def _condition_is_met(self, action: Construct) -> bool:
        decided = condition_value(action.get("condition"), self.steps)
        if decided is None:
            reason = f"the condition of {action.short_name} is not known"
            self.reader.lose(reason, action)
        return decided is True

    def group(self, action: Construct, scope: Scope) -> Scope:
        if action.get("launch_configurations") or action.get("forwarding") is False:
            self.reader.lose("launch arguments that only a group has", action)
        inside = self.add_all(listed(action.get("actions", 0)), scope)
        return inside if action.get("scoped") is False else scope

    def opaque(self, action: Construct, scope: Scope) -> Scope:
        """A function that is called at launch; `launch_files` has added what it returns."""
        if "actions" not in action.keywords:
            self.reader.lose("what a function makes when the file is launched", action)
        return self.add_all(listed(action.get("actions")), scope)

    def timer(self, action: Construct, scope: Scope) -> Scope:
        self.reader.change("the delay of a TimerAction is left out: readiness is observed", action)
        return self.add_all(listed(action.get("actions")), scope)

    def handler(self, action: Construct, scope: Scope) -> Scope:
        """An event handler: what it starts when another process starts, ends or prints."""
        event = action.get("event_handler", 0)
        if not isinstance(event, Construct):
            self.reader.lose("an event handler is not known", action)
            return scope
        actions = [
            part
            for key, value in event.keywords.items()
            if not key.startswith("target") and key not in {"start_state", "goal_state"}
            for part in listed(value)
        ]
        if event.short_name == "OnStateTransition" and all(
            is_quiet(part) or changed_state(part) is not None for part in actions
        ):
            return self.add_all(actions, scope)
        if event.short_name == "OnProcessStart" and all(isinstance(x, Construct) for x in actions):
            self.reader.change(
                "what an event handler starts after another process is started with it", action
            )
            return self.add_all(actions, scope)
        if all(is_quiet(part) for part in actions):
            what = "what an event handler does is left out: it starts nothing"
            self.reader.change(what, action)
        else:
            self.reader.lose("what an event handler starts is left out", action)
        return scope

    def event(self, action: Construct, _scope: Scope) -> None:
        change = changed_state(action)
        if change is not None:
            matcher = change.get("lifecycle_node_matcher", 0)
            node = matcher.get("action", 0) if isinstance(matcher, Construct) else None
            transition = change.get("transition_id", 1)
            name = transition.name if isinstance(transition, Foreign) else str(transition)
            self.transitions.append((action, node, name.rpartition("_")[2].lower()))
        elif not is_quiet(action):
            self.reader.lose("an event that the launch file sends", action)

    def change_states(self) -> None:
        """Give lifecycle nodes the state into which the file brings them."""
        for action, target, transition in self.transitions:
            state = _STATES.get(transition)
            nodes = [node for node in self.parts.nodes if node.source is target]
            if state is None or not nodes:
                self.reader.lose("a transition of a lifecycle node is not known", action)
            for node in nodes:
                node.lifecycle = "active" if node.lifecycle == "active" else state or ""

    def description(self, action: Construct, scope: Scope) -> Scope:
        return self.add_all(listed(action.get("initial_entities", 0)), scope)

    def node(self, action: Construct, scope: Scope) -> None:
        if self.reader.is_container(action):
            self._container(action, scope)
        else:
            self._append(self.parts.nodes, self.reader.executable(action, scope))

    def process(self, action: Construct, scope: Scope) -> None:
        self._append(self.parts.nodes, self.reader.program(action, scope))

    def container(self, action: Construct, scope: Scope) -> None:
        container = self._container(action, scope)
        self._components(
            action.get("composable_node_descriptions"), scope, container.name, container.source
        )

    def _container(self, action: Construct, scope: Scope) -> ContainerAction:
        container = self.reader.container(action, scope)
        if container.name in self.parts.containers:
            container.name = identifier(container.full_name)
        self.parts.containers[container.name] = container
        return container

    def load(self, action: Construct, scope: Scope) -> None:
        target = action.get("target_container", 1)
        if not isinstance(target, Construct) or "executable" not in target.keywords:
            target = performed(target, action, self.steps)
            if isinstance(target, Unknown):
                self.reader.lose(f"the container is not known: {target.reason}", action)
                target = "container"
        self._components(action.get("composable_node_descriptions", 0), scope, "", target)

    def _components(self, descriptions: Any, scope: Scope, container: str, target: Any) -> None:
        for action in listed(descriptions):
            if isinstance(action, Unknown):
                self.parts.ignored.append(action)
            if not isinstance(action, Construct) or not self._condition_is_met(action):
                continue
            if not action.short_name.endswith("ComposableNode"):
                self._leave_out(f"the node that {action.short_name} makes is not known", action)
                continue
            node = self.reader.component(action, scope, container)
            self._append(self.parts.nodes, node)
            if node is not None and not container:
                self.targets.append((node, target))

    def place_components(self) -> None:
        """Give the components that are loaded into another container the name of that one."""
        containers = self.parts.containers.values()
        for node, target in self.targets:
            if isinstance(target, Construct):
                same = [each for each in containers if each.source is target]
                last = self.reader.text(target, "name")
            else:
                last = target.rpartition("/")[2]
                full = f"/{target.strip('/')}"
                same = [each for each in containers if each.full_name == full]
            alike = [each for each in containers if each.full_name.rpartition("/")[2] == last]
            if same or len(alike) == 1:
                node.container = (same or alike)[0].name
                continue
            node.container = identifier(last)
            if node.container not in self.parts.containers:
                what = f"the container {last!r} is started elsewhere; here it is one of the spec"
                self.reader.change(what, node.source)

    def _append(self, members: list[Any], member: Member | None) -> None:
        if member is None:
            return
        members.append(member)
        if len(self.parts.nodes) + len(self.parts.includes) > MAX_LAUNCH_PARTS:
            raise ScriptLimitError(f"more than {MAX_LAUNCH_PARTS:,} nodes and included files")

    def include(self, action: Construct, scope: Scope) -> Scope:
        source = action.get("launch_description_source", 0)
        if isinstance(source, Construct):
            source = source.get("location", 0, source.get("launch_file_path"))
        path = performed(source, action, self.steps)
        if isinstance(path, Unknown) or not path:
            self.reader.lose("the file of an included launch file", action)
            return scope
        include = IncludeAction(
            action,
            path=str(path),
            arguments=self._launch_arguments(action),
            namespace=absolute(scope.namespace),
            remappings=list(scope.remappings),
            environment=dict(scope.environment),
        )
        if path.startswith("$(share ") and ")/" in path:
            inside = path.removeprefix("$(share ")
            include.path, (include.package, _, include.file) = "", inside.partition(")/")
        is_near = self.included < MAX_LAUNCH_INCLUDES
        launched = self.expand(include, scope.arguments) if is_near else None
        if launched is None:
            if scope.parameters:
                self.reader.lose("parameters that are set for an included launch file", action)
            self._append(self.parts.includes, include)
            return replace(scope, arguments={**scope.arguments, **include.arguments})
        self.included += 1
        outside, self.arguments = self.arguments, launched.values
        scope = self.add_all(launched.actions, replace(scope, arguments=launched.values))
        self.included -= 1
        self.arguments = outside
        return scope

    def _launch_arguments(self, action: Construct) -> dict[str, Any]:
        given = action.get("launch_arguments", default=[])
        pairs = list(given.items()) if isinstance(given, dict) else listed(given)
        arguments: dict[str, Any] = {}
        for pair in pairs:
            if isinstance(pair, list | tuple) and len(pair) == 2:
                name, value = performed(pair[0], action, self.steps), pair[1]
                if not isinstance(value, bool | int | float):
                    value = performed(value, action, self.steps)
                # A text stays as it is written: expressions of Python tell True from true.
                arguments[str(name)] = str(value) if isinstance(value, str) else value
            else:
                reason = pair.reason if isinstance(pair, Unknown) else "it is no pair"
                self.reader.lose(f"an argument of an included file is not known: {reason}", action)
        return arguments


_ACTIONS: Final[dict[str, Callable[[_Collector, Construct, Scope], Scope | None]]] = {
    "GroupAction": _Collector.group,
    "OpaqueFunction": _Collector.opaque,
    "TimerAction": _Collector.timer,
    "RosTimer": _Collector.timer,
    "RegisterEventHandler": _Collector.handler,
    "EmitEvent": _Collector.event,
    "LaunchDescription": _Collector.description,
    "Node": _Collector.node,
    "LifecycleNode": _Collector.node,
    "ExecuteProcess": _Collector.process,
    "ExecuteLocal": _Collector.process,
    "ComposableNodeContainer": _Collector.container,
    "LoadComposableNodes": _Collector.load,
    "IncludeLaunchDescription": _Collector.include,
}


def topic_in(namespace: str, topic: str) -> str:
    """The absolute name of a topic."""
    return topic if topic.startswith("/") else f"{namespace.rstrip('/')}/{topic}"
