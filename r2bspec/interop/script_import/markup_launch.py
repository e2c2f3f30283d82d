"""Launch files in XML and YAML as the same actions that a launch file in Python makes.

Both notations have the same entities: a name, attributes, and entities inside. References such as
``$(var x)`` are replaced where their values are known; a text with another one is unknown.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, Final

from r2bspec.diagnostics import Span
from r2bspec.diagnostics.quote import clip
from r2bspec.interop.script_import.launch_files import LaunchArgument, LaunchFile
from r2bspec.interop.script_import.launch_texts import condition_value
from r2bspec.interop.script_import.source_files import SYNTAX, ScriptReader, UnusableScriptError
from r2bspec.interop.script_import.substitutions import split_words, substituted
from r2bspec.interop.script_import.values import Construct, ImportNote, LaunchText, Unknown
from r2bspec.plan.launch_markup import Entity, MarkupError, read_markup

_ACTIONS: Final = {
    "node": "Node",
    "lifecycle_node": "LifecycleNode",
    "node_container": "ComposableNodeContainer",
    "load_composable_node": "LoadComposableNodes",
    "executable": "ExecuteProcess",
    "group": "GroupAction",
    "timer": "TimerAction",
    "ros_timer": "RosTimer",
    "include": "IncludeLaunchDescription",
    "set_remap": "SetRemap",
    "set_parameter": "SetParameter",
    "set_parameters_from_file": "SetParametersFromFile",
    "set_use_sim_time": "SetUseSimTime",
    "set_env": "SetEnvironmentVariable",
    "set_ros_log_dir": "SetROSLogDir",
    "push_ros_namespace": "PushRosNamespace",
    "push_namespace": "PushRosNamespace",
    "log": "LogInfo",
    "log_info": "LogInfo",
    "shutdown": "Shutdown",
}
"""The actions of Python, by the names of entities."""
_KEYWORDS: Final = {
    "name": "name",
    "pkg": "package",
    "exec": "executable",
    "plugin": "plugin",
    "namespace": "namespace",
    "target": "target_container",
    "file": "launch_description_source",
    "filename": "filename",
    "from": "src",
    "to": "dst",
    "launch_prefix": "prefix",
    "new_log_dir": "new_log_dir",
}
"""Their arguments, by the names of attributes."""
_RENAMED: Final = {"SetParametersFromFile": {"file": "filename"}}
_COMMAND_LINES: Final = {"ros_args": "ros_arguments", "args": "arguments", "cmd": "cmd"}
_CONDITIONS: Final = {"unless": "UnlessCondition", "if": "IfCondition"}
_FLAGS: Final = frozenset({"shell", "scoped", "forwarding"})
_VALUES: Final = frozenset({"SetParameter", "SetEnvironmentVariable", "SetUseSimTime"})
"""Actions whose attribute ``value`` is what they set."""


def markup_launch_file(reader: ScriptReader, file: Path, given: Mapping[str, Any]) -> LaunchFile:
    """What a launch file in XML or YAML does, with the launch arguments given and its defaults.

    Raises:
        UnusableScriptError: it cannot be read or parsed.
        ScriptLimitError: it exceeds the limits.
    """
    try:
        root = read_markup(reader.read_text(file).removeprefix("\ufeff"), file)
    except MarkupError as error:
        raise UnusableScriptError(SYNTAX, str(error), error.span) from error
    markup = _Markup(reader, file, given)
    markup.launch.actions = list(markup.actions(root.children))
    return markup.launch


class _Markup:
    """Evaluates the entities of one file, in their order."""

    def __init__(self, reader: ScriptReader, file: Path, given: Mapping[str, Any]) -> None:
        self.folder = reader.reference(file).rpartition("/")[0]
        self.steps = reader.steps
        self.launch = LaunchFile(values=dict(given))
        self.place = Span.of_file(str(file))

    @property
    def values(self) -> dict[str, Any]:
        """The values of arguments and variables at this place of the file."""
        return self.launch.values

    def actions(self, entities: list[Entity]) -> Iterator[Construct]:
        for entity in entities:
            self.place = entity.place
            if entity.name in {"arg", "let", "set_launch_configuration"}:
                self._declare(entity)
            elif entity.name in _ACTIONS:
                yield self._construct(_ACTIONS[entity.name], entity)
            else:
                self._lose(f"<{clip(entity.name)}> has no form in a spec")

    def _lose(self, reason: str) -> None:
        self.launch.notes.append(ImportNote(reason, self.place))

    def _declare(self, entity: Entity) -> None:
        name = entity.get("name")
        decided = condition_value(self._condition(entity), self.steps)
        if decided is None:
            self._lose(f"the condition of <{entity.name}> is not known")
        if not decided:
            return
        is_given = bool(entity.values.keys() & {"value", "default"})
        value = self._text(entity.get("value", "default")) if is_given else None
        if entity.name == "arg":
            choices = tuple(choice.get("value") for choice in entity.all("choice"))
            default = value if isinstance(value, str) else None
            self.launch.declare(LaunchArgument(name, default, choices, self.place))
            if isinstance(value, Unknown):
                self.values.setdefault(name, value)
        elif is_given:
            self.values[name] = value

    def _condition(self, entity: Entity) -> Construct | None:
        for name, condition in _CONDITIONS.items():
            if name in entity.values:
                text = {"predicate_expression": self._text(entity.get(name))}
                return Construct(condition, [], text, entity.place)
        return None

    def _construct(self, kind: str, entity: Entity) -> Construct:
        """The construct of an entity, with its attributes and the entities inside as keywords."""
        self.steps.count(1 + len(entity.children))
        place = self.place = entity.place
        keywords: dict[str, Any] = {"condition": self._condition(entity)}
        named = _KEYWORDS | _RENAMED.get(kind, {})
        for name, value in entity.values.items():
            if name in named:
                keywords[named[name]] = self._text(entity.get(name))
            elif name in _COMMAND_LINES:
                words = split_words(entity.get(name))
                keywords[_COMMAND_LINES[name]] = [self._text(word) for word in words]
            elif name in _FLAGS:
                keywords[name] = str(self._text(entity.get(name))).lower() not in {"false", "0"}
            elif name == "value" and kind in _VALUES:
                keywords["value"] = self._value(entity)
            elif name not in _CONDITIONS and not isinstance(value, list):
                keywords[name] = self._text(entity.get(name))
        if kind == "GroupAction":
            keywords["actions"] = self._inside_group(entity, keywords)
        elif kind in {"TimerAction", "RosTimer"}:
            keywords["actions"] = list(self.actions(entity.children))
        elif kind == "IncludeLaunchDescription":
            given = [*entity.all("arg"), *entity.all("let")]
            keywords["launch_arguments"] = dict(map(self._argument, given))
        else:
            self._add_children(keywords, entity)
        return Construct(kind, [], keywords, place)

    def _inside_group(self, entity: Entity, keywords: dict[str, Any]) -> list[Construct]:
        """Variables that are set in a group end with it, and are not set if it is left out."""
        before = dict(self.values)
        decided = condition_value(keywords["condition"], self.steps)
        actions = list(self.actions(entity.children)) if decided is not False else []
        if keywords.get("scoped") is not False:
            self.launch.values = before
        return actions

    def _add_children(self, keywords: dict[str, Any], entity: Entity) -> None:
        value: Any
        for child in entity.children:
            self.place = child.place
            match child.name:
                case "composable_node":
                    key = "composable_node_descriptions"
                    value = self._construct("ComposableNode", child)
                case "remap":
                    key, value = "remappings", self._pair(child, "from", "to")
                case "param":
                    key, value = "parameters", self._source(child)
                case "env":
                    key, value = "additional_env", self._pair(child, "name", "value")
                case "extra_arg":
                    key, value = "extra_arguments", self._named_value(child)
                case name:
                    self._lose(f"<{clip(name)}> in <{clip(entity.name)}> has no form in a spec")
                    continue
            keywords.setdefault(key, []).append(value)

    def _pair(self, entity: Entity, first: str, second: str) -> tuple[Any, Any]:
        return self._text(entity.get(first)), self._text(entity.get(second))

    def _named_value(self, entity: Entity) -> dict[Any, Any]:
        return {self._text(entity.get("name")): self._value(entity)}

    def _source(self, entity: Entity) -> Any:
        """The parameters of ``<param>``: a file, or a map."""
        if "from" not in entity.values:
            return self._named_value(entity)
        file = self._text(entity.get("from"))
        allowed = self._text(entity.get("allow_substs") or "false")
        if allowed in {"false", "False", "0"}:
            return file
        keywords = {"param_file": file, "allow_substs": True}
        return Construct("ParameterFile", [], keywords, self.place)

    def _argument(self, entity: Entity) -> tuple[Any, Any]:
        name, value = self._pair(entity, "name", "value")
        return name, LaunchText(value) if isinstance(value, str) else value

    def _value(self, entity: Entity) -> Any:
        self.place = entity.place
        if entity.children:
            self.steps.count(len(entity.children))
            return {self._text(each.get("name")): self._value(each) for each in entity.all("param")}
        value = entity.values.get("value", "")
        text = self._text(value) if isinstance(value, str) else value
        if not isinstance(text, str):
            return text
        separator = entity.values.get("value_sep")
        if isinstance(separator, str) and separator:
            return [[LaunchText(part)] for part in text.split(separator)]
        return str(text) if entity.get("type") == "str" else LaunchText(text)

    def _text(self, text: str) -> Any:
        """A text with its references replaced; unknown if the value of one is not known."""
        result = substituted(text, self.values, self.steps, self.folder)
        reason = f"the value of {clip(text)} is not known"
        return Unknown(reason, self.place) if result is None else result
