"""Launch files in XML and YAML as the same actions that a launch file in Python makes.

Both notations have the same entities: a name, attributes, and entities inside. References such as
``$(var x)`` are replaced where their values are known; a text with another one is unknown. A
document type, with which XML declares entities that expand, is refused by the parser itself.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final
from xml.parsers import expat

import yaml

from r2bspec.diagnostics import Span
from r2bspec.diagnostics.quote import clip
from r2bspec.interop.script_import.launch_files import LaunchArgument, LaunchFile
from r2bspec.interop.script_import.launch_texts import condition_value
from r2bspec.interop.script_import.source_files import SYNTAX, ScriptReader, UnusableScriptError
from r2bspec.interop.script_import.substitutions import split_words, substituted
from r2bspec.interop.script_import.values import Construct, ImportNote, LaunchText, Unknown
from r2bspec.safe_io.limits import MAX_MARKUP_DEPTH
from r2bspec.safe_io.safe_yaml import load_values

_CHILDREN: Final = frozenset(
    {
        *("param", "remap", "env", "extra_arg", "composable_node"),
        *("arg", "let", "node", "group", "include", "choice"),
    }
)
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


@dataclass(slots=True)
class _Entity:
    """One entity: its name, attributes and children."""

    name: str
    place: Span
    values: dict[str, Any] = field(default_factory=dict)
    children: list[_Entity] = field(default_factory=list)

    def all(self, name: str) -> list[_Entity]:
        return [child for child in self.children if child.name == name]

    def get(self, *names: str) -> str:
        for name in names:
            value = self.values.get(name)
            if isinstance(value, str | int | float | bool):
                return str(value)
        return ""


def markup_launch_file(reader: ScriptReader, file: Path, given: Mapping[str, Any]) -> LaunchFile:
    """What a launch file in XML or YAML does, with the launch arguments given and its defaults.

    Raises:
        UnusableScriptError: it cannot be read or parsed.
        ScriptLimitError: it exceeds the limits.
    """
    text = reader.read_text(file).removeprefix("\ufeff")
    is_xml = text.lstrip().startswith("<") or (file.suffix == ".xml" and not text.strip())
    root = _xml(file, text) if is_xml else _yaml(file, text)
    markup = _Markup(reader, file, given)
    markup.launch.actions = list(markup.actions(root.children))
    return markup.launch


def _xml(file: Path, text: str) -> _Entity:
    parser = expat.ParserCreate(namespace_separator="}")
    path = [_Entity("", Span.of_file(str(file)))]

    def refused(reason: str) -> UnusableScriptError:
        return _syntax(file, reason, parser.CurrentLineNumber, parser.CurrentColumnNumber + 1)

    def doctype(*_: object) -> None:
        raise refused("declarations (<!DOCTYPE>, <!ENTITY>) are refused")

    def start(name: str, attributes: dict[str, str]) -> None:
        if len(path) > MAX_MARKUP_DEPTH + 1:
            raise _syntax(file, f"entities are nested more than {MAX_MARKUP_DEPTH} times", 1, 1)
        line, column = parser.CurrentLineNumber, parser.CurrentColumnNumber + 1
        place = Span(str(file), line, column, line, column + len(name) + 1)
        values = {key.replace("-", "_"): value for key, value in attributes.items()}
        entity = _Entity(name.replace("-", "_"), place, values)
        path[-1].children.append(entity)
        path.append(entity)

    parser.StartDoctypeDeclHandler = doctype
    parser.StartElementHandler = start
    parser.EndElementHandler = lambda _: path.pop()
    try:
        parser.Parse(text, True)
    except expat.ExpatError as error:
        raise _syntax(file, f"invalid XML: {error}", error.lineno, error.offset + 1) from error
    return path[0].children[0]


def _yaml(file: Path, text: str) -> _Entity:
    try:
        content = load_values(text)
        root = yaml.compose(text, Loader=getattr(yaml, "CSafeLoader", yaml.SafeLoader))
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        line, column = (mark.line + 1, mark.column + 1) if mark is not None else (1, 1)
        raise _syntax(file, f"invalid YAML: {error}".split("\n")[0], line, column) from error
    if not isinstance(content, dict) or not isinstance(content.get("launch"), list):
        raise _syntax(file, "a launch file in YAML has a list under the key 'launch'", 1, 1)
    inside = [*_listed(str(file), *_entries(content, root)["launch"], 0)]
    return _Entity("launch", Span.of_file(str(file)), {}, inside)


def _listed(file: str, items: Any, node: Any, depth: int) -> Iterator[_Entity]:
    """The entities of a list of values, with the places of the nodes that these are made of."""
    for values, at in _pairs(items, node) if depth < MAX_MARKUP_DEPTH else ():
        for name, (value, below) in _entries(values, at).items():
            yield _entity(file, name, value, below, depth)


def _entity(file: str, name: str, values: Any, node: Any, depth: int) -> _Entity:
    line, column = node.start_mark.line + 1, node.start_mark.column + 1
    entity = _Entity(name.replace("-", "_"), Span(file, line, column, line, column + 1))
    if isinstance(values, list):
        entity.children += _listed(file, values, node, depth + 1)
    for key, (value, below) in _entries(values, node).items():
        entity.values[key.replace("-", "_")] = value
        if key in _CHILDREN:
            pairs = _pairs(value, below)
            entity.children += [_entity(file, key, *pair, depth + 1) for pair in pairs]
        elif key == "children":
            entity.children += _listed(file, value, below, depth + 1)
    return entity


def _pairs(values: Any, node: Any) -> list[tuple[Any, Any]]:
    """The items of a list with their nodes; none of another value."""
    items = values if isinstance(values, list) else []
    nodes = node.value if isinstance(node, yaml.SequenceNode) else [node] * len(items)
    return list(zip(items, nodes, strict=False))


def _entries(values: Any, node: Any) -> dict[str, tuple[Any, Any]]:
    """The values of a map with their nodes, or that of a map where a merge key brings them."""
    items = values.items() if isinstance(values, dict) else ()
    pairs = node.value if isinstance(node, yaml.MappingNode) else ()
    nodes = {key.value: below for key, below in pairs}
    return {str(key): (value, nodes.get(str(key), node)) for key, value in items}


def _syntax(file: Path, message: str, line: int, column: int) -> UnusableScriptError:
    return UnusableScriptError(SYNTAX, message, Span(str(file), line, column, line, column + 1))


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

    def actions(self, entities: list[_Entity]) -> Iterator[Construct]:
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

    def _declare(self, entity: _Entity) -> None:
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

    def _condition(self, entity: _Entity) -> Construct | None:
        for name, condition in _CONDITIONS.items():
            if name in entity.values:
                text = {"predicate_expression": self._text(entity.get(name))}
                return Construct(condition, [], text, entity.place)
        return None

    def _construct(self, kind: str, entity: _Entity) -> Construct:
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

    def _inside_group(self, entity: _Entity, keywords: dict[str, Any]) -> list[Construct]:
        """Variables that are set in a group end with it, and are not set if it is left out."""
        before = dict(self.values)
        decided = condition_value(keywords["condition"], self.steps)
        actions = list(self.actions(entity.children)) if decided is not False else []
        if keywords.get("scoped") is not False:
            self.launch.values = before
        return actions

    def _add_children(self, keywords: dict[str, Any], entity: _Entity) -> None:
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

    def _pair(self, entity: _Entity, first: str, second: str) -> tuple[Any, Any]:
        return self._text(entity.get(first)), self._text(entity.get(second))

    def _named_value(self, entity: _Entity) -> dict[Any, Any]:
        return {self._text(entity.get("name")): self._value(entity)}

    def _source(self, entity: _Entity) -> Any:
        """The parameters of ``<param>``: a file, or a map."""
        if "from" not in entity.values:
            return self._named_value(entity)
        file = self._text(entity.get("from"))
        allowed = self._text(entity.get("allow_substs") or "false")
        if allowed in {"false", "False", "0"}:
            return file
        keywords = {"param_file": file, "allow_substs": True}
        return Construct("ParameterFile", [], keywords, self.place)

    def _argument(self, entity: _Entity) -> tuple[Any, Any]:
        name, value = self._pair(entity, "name", "value")
        return name, LaunchText(value) if isinstance(value, str) else value

    def _value(self, entity: _Entity) -> Any:
        self.place = entity.place
        if entity.children:
            self.steps.count(len(entity.children))
            return {
                self._text(parameter.get("name")): self._value(parameter)
                for parameter in entity.all("param")
            }
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
