"""Launch files in XML and YAML as the same actions that a launch file in Python makes.

Both notations have the same entities: a name, attributes, and entities inside. References such as
``$(var x)`` are replaced where their values are known; a text with another one is unknown. A
document type, with which XML declares entities that expand, is refused by the parser itself.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final
from xml.parsers import expat

import yaml

from r2bspec.diagnostics import Span
from r2bspec.diagnostics.quote import clip
from r2bspec.interop.script_import.source_files import SYNTAX, ScriptReader, UnusableScriptError
from r2bspec.interop.script_import.substitutions import split_words, substituted
from r2bspec.interop.script_import.values import Construct, LaunchText, Note, StepCounter, Unknown
from r2bspec.language.yaml_document import ScalarError, resolve
from r2bspec.safe_io.limits import MAX_MARKUP_DEPTH
from r2bspec.safe_io.safe_yaml import load_values

_CHILDREN: Final = frozenset(
    {
        *("param", "remap", "env", "extra_arg", "composable_node"),
        *("arg", "let", "node", "group", "include"),
    }
)
_ACTIONS: Final = {
    "node": "Node",
    "node_container": "ComposableNodeContainer",
    "load_composable_node": "LoadComposableNodes",
    "executable": "ExecuteProcess",
    "group": "GroupAction",
    "include": "IncludeLaunchDescription",
    "set_remap": "SetRemap",
    "push_ros_namespace": "PushRosNamespace",
    "push_namespace": "PushRosNamespace",
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
    "from": "src",
    "to": "dst",
}
"""Their arguments, by the names of attributes."""
_COMMAND_LINES: Final = {"ros_args": "arguments", "args": "arguments", "cmd": "cmd"}
_CONDITIONS: Final = {"unless": "UnlessCondition", "if": "IfCondition"}


@dataclass(slots=True)
class _Entity:
    """One entity: its name, attributes and children."""

    name: str
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


def markup_launch_actions(
    reader: ScriptReader, file: Path, arguments: Mapping[str, Any]
) -> tuple[list[Any], list[Note]]:
    """The actions of a launch file in XML or YAML.

    Raises:
        UnusableScriptError: it cannot be read or parsed.
        ScriptLimitError: it exceeds the limits.
    """
    text = reader.read_text(file)
    root = _xml(file, text) if text.lstrip().startswith("<") else _yaml(file, text)
    markup = _Markup(file, dict(arguments), reader.steps)
    return markup.actions(root.children), markup.notes


def _xml(file: Path, text: str) -> _Entity:
    parser = expat.ParserCreate(namespace_separator="}")
    path = [_Entity("")]

    def refused(reason: str) -> UnusableScriptError:
        return _syntax(file, reason, parser.CurrentLineNumber, parser.CurrentColumnNumber + 1)

    def doctype(*_: object) -> None:
        raise refused("declarations (<!DOCTYPE>, <!ENTITY>) are refused")

    def start(name: str, attributes: dict[str, str]) -> None:
        if len(path) > MAX_MARKUP_DEPTH + 1:
            raise _syntax(file, f"entities are nested more than {MAX_MARKUP_DEPTH} times", 1, 1)
        entity = _Entity(name.replace("-", "_"), dict(attributes))
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
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        line, column = (mark.line + 1, mark.column + 1) if mark is not None else (1, 1)
        raise _syntax(file, f"invalid YAML: {error}".split("\n")[0], line, column) from error
    if not isinstance(content, dict) or not isinstance(content.get("launch"), list):
        raise _syntax(file, "a launch file in YAML has a list under the key 'launch'", 1, 1)
    return _Entity("launch", {}, _entities(content["launch"], 0))


def _entities(items: Any, depth: int) -> list[_Entity]:
    return [
        _mapping_entity(str(name), values, depth)
        for item in (items if isinstance(items, list) and depth < MAX_MARKUP_DEPTH else [])
        for name, values in (item.items() if isinstance(item, dict) else ())
    ]


def _mapping_entity(name: str, values: Any, depth: int) -> _Entity:
    name = name.replace("-", "_")
    if isinstance(values, list):
        return _Entity(name, {}, _entities(values, depth + 1))
    values = values if isinstance(values, dict) else {}
    children: list[_Entity] = []
    for key, inside in values.items():
        if isinstance(inside, list):
            if key in _CHILDREN:
                children += [_mapping_entity(key, child, depth + 1) for child in inside]
            elif key == "children":
                children += _entities(inside, depth + 1)
    return _Entity(name, values, children)


def _syntax(file: Path, message: str, line: int, column: int) -> UnusableScriptError:
    return UnusableScriptError(SYNTAX, message, Span(str(file), line, column, line, column + 1))


class _Markup:
    def __init__(self, file: Path, values: dict[str, Any], steps: StepCounter) -> None:
        self.place = Span(str(file), 1, 1, 1, 2)
        self.values = values
        self.steps = steps
        self.notes: list[Note] = []

    def actions(self, entities: list[_Entity]) -> list[Construct]:
        actions = []
        for entity in entities:
            if entity.name in {"arg", "let"}:
                self._declare(entity)
            elif entity.name in _ACTIONS:
                actions.append(self._construct(_ACTIONS[entity.name], entity))
            else:
                reason = f"<{clip(entity.name)}> has no form in a spec"
                self.notes.append(Note(reason, self.place))
        return actions

    def _declare(self, entity: _Entity) -> None:
        name = entity.get("name")
        is_open = entity.name == "let" or name not in self.values
        if is_open and entity.values.keys() & {"value", "default"}:
            self.values[name] = self._text(entity.get("value", "default"))

    def _construct(self, kind: str, entity: _Entity) -> Construct:
        """The construct of an entity, with its attributes and the entities inside as keywords."""
        self.steps.count(1 + len(entity.children))
        keywords: dict[str, Any] = {}
        for name, keyword in _KEYWORDS.items():
            if name in entity.values:
                keywords[keyword] = self._text(entity.get(name))
        for name, keyword in _COMMAND_LINES.items():
            if name in entity.values:
                words = split_words(entity.get(name))
                keywords[keyword] = [self._text(word) for word in words]
        for name, condition in _CONDITIONS.items():
            if name in entity.values:
                text = {"predicate_expression": self._text(entity.get(name))}
                keywords["condition"] = Construct(condition, [], text, self.place)
        if kind == "GroupAction":
            keywords["actions"] = self.actions(entity.children)
        elif kind == "IncludeLaunchDescription":
            given = [*entity.all("arg"), *entity.all("let")]
            keywords["launch_arguments"] = dict(map(self._argument, given))
        else:
            keywords["composable_node_descriptions"] = [
                self._construct("ComposableNode", child) for child in entity.all("composable_node")
            ]
            keywords["remappings"] = [
                (self._text(remap.get("from")), self._text(remap.get("to")))
                for remap in entity.all("remap")
            ]
            keywords["parameters"] = [
                self._text(param.get("from"))
                if "from" in param.values
                else {self._text(param.get("name")): self._value(param)}
                for param in entity.all("param")
            ]
        return Construct(kind, [], keywords, self.place)

    def _argument(self, entity: _Entity) -> tuple[Any, Any]:
        name, value = self._text(entity.get("name")), self._text(entity.get("value"))
        return name, LaunchText(value) if isinstance(value, str) else value

    def _value(self, entity: _Entity) -> Any:
        if entity.children:
            self.steps.count(len(entity.children))
            return {self._text(each.get("name")): self._value(each) for each in entity.all("param")}
        value = entity.values.get("value", "")
        text = self._text(value) if isinstance(value, str) else value
        if not isinstance(text, str):
            return text
        try:
            plain = resolve(text)
        except ScalarError:
            return text
        return plain if isinstance(plain, bool | int | float) else text

    def _text(self, text: str) -> Any:
        """A text with its references replaced; unknown if the value of one is not known."""
        result = substituted(text, self.values, self.steps)
        reason = f"the value of {clip(text)} is not known"
        return Unknown(reason, self.place) if result is None else result
