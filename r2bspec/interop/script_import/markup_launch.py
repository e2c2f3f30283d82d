"""Launch files in XML and YAML as the same actions that a launch file in Python makes.

Both notations have the same entities and attributes. References such as ``$(var x)`` are replaced
where their values are known; a text with another one is unknown. Entities of XML are refused.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import yaml

from r2bspec.diagnostics import Diagnostic, Severity, Span
from r2bspec.interop.script_import.evaluator import Note
from r2bspec.interop.script_import.launch_references import substituted
from r2bspec.interop.script_import.script_reader import (
    SYNTAX,
    ScriptReader,
    UnusableScriptError,
)
from r2bspec.interop.script_import.script_values import Construct, LaunchText, Place, Unknown
from r2bspec.language.yaml_scalars import ScalarError, resolve
from r2bspec.untrusted.safe_yaml import load_values

_WORD = re.compile(r"(?:\$\([^)]*\)|\S)+")
_CHILDREN = frozenset(
    {
        "param",
        "remap",
        "env",
        "composable_node",
        "arg",
        "node",
        "group",
        "include",
        "let",
        "extra_arg",
    }
)
_MAX_DEPTH = 40


class _Entity:
    """One entity: its name, attributes and children, with its line (1 where it is not known)."""

    def __init__(self, name: str, values: dict[str, Any], children: list[_Entity]) -> None:
        self.name, self.values, self.children = name.replace("-", "_"), values, children

    def all(self, name: str) -> list[_Entity]:
        return [each for each in self.children if each.name == name]

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
    """
    text = reader.read_text(file)
    root = _xml(file, text) if text.lstrip().startswith("<") else _yaml(file, text)
    made = _Markup(file, dict(arguments))
    return made.actions(root.children), made.notes


def _xml(file: Path, text: str) -> _Entity:
    if "<!" in re.sub(r"<!--.*?-->", "", text, flags=re.DOTALL):
        raise _syntax(file, "declarations (<!DOCTYPE>, <!ENTITY>) are refused", 1, 1)
    try:
        root = ElementTree.fromstring(text)  # noqa: S314 - without entities, see above
    except ElementTree.ParseError as error:
        line, column = error.position
        raise _syntax(file, f"invalid XML: {error}", line, column + 1) from error
    return _entity_of(file, root, 0)


def _entity_of(file: Path, element: ElementTree.Element, depth: int) -> _Entity:
    if depth > _MAX_DEPTH:
        raise _syntax(file, f"entities are nested more than {_MAX_DEPTH} times", 1, 1)
    children = [_entity_of(file, each, depth + 1) for each in element]
    return _Entity(element.tag, dict(element.attrib), children)


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
    found: list[_Entity] = []
    for item in items if isinstance(items, list) and depth < _MAX_DEPTH else []:
        for name, values in item.items() if isinstance(item, dict) else ():
            found.append(_mapping_entity(str(name), values, depth))
    return found


def _mapping_entity(name: str, values: Any, depth: int) -> _Entity:
    if isinstance(values, list):
        return _Entity(name, {}, _entities(values, depth + 1))
    values = values if isinstance(values, dict) else {}
    children: list[_Entity] = []
    for key, inner in values.items():
        if isinstance(inner, list):
            if key in _CHILDREN:
                children += [_mapping_entity(key, each, depth + 1) for each in inner]
            elif key == "children":
                children += _entities(inner, depth + 1)
    return _Entity(name, values, children)


def _syntax(file: Path, message: str, line: int, column: int) -> UnusableScriptError:
    span = Span(str(file), line, column, line, column + 1)
    return UnusableScriptError(Diagnostic(SYNTAX, Severity.ERROR, message, span))


class _Markup:
    def __init__(self, file: Path, values: dict[str, Any]) -> None:
        self.place = Place(file, 1)
        self.values = values
        self.notes: list[Note] = []

    def actions(self, entities: list[_Entity]) -> list[Construct]:
        found = []
        for each in entities:
            if each.name in {"arg", "let"}:
                self._declare(each)
                continue
            made = self._action(each)
            if made is not None:
                found.append(made)
        return found

    def _declare(self, entity: _Entity) -> None:
        name = entity.get("name")
        if entity.name == "let" or name not in self.values:
            value = self._text(entity.get("value", "default"))
            if entity.values.keys() & {"value", "default"}:
                self.values[name] = value

    def _action(self, entity: _Entity) -> Construct | None:
        maker = _MAKERS.get(entity.name)
        if maker is None:
            self.notes.append(Note(f"<{entity.name}> has no form in a spec", self.place))
            return None
        name, own = maker(self, entity)
        return self._construct(name, self._condition(entity) | own)

    def _condition(self, entity: _Entity) -> dict[str, Any]:
        for name, kind in (("if", "IfCondition"), ("unless", "UnlessCondition")):
            if name in entity.values:
                text = self._text(entity.get(name))
                return {"condition": self._construct(kind, {"predicate_expression": text})}
        return {}

    def _construct(self, name: str, keywords: dict[str, Any]) -> Construct:
        return Construct(name, [], keywords, self.place)

    def node(self, entity: _Entity) -> tuple[str, dict[str, Any]]:
        words = [self._text(each) for each in _WORD.findall(entity.get("args", "ros_args"))]
        return "Node", self._node(entity) | {
            "executable": self._text(entity.get("exec")),
            "arguments": words,
        }

    def container(self, entity: _Entity) -> tuple[str, dict[str, Any]]:
        inside = [
            self._construct("ComposableNode", self._condition(each) | self._node(each))
            for each in entity.all("composable_node")
        ]
        return "ComposableNodeContainer", self._node(entity) | {
            "executable": self._text(entity.get("exec")),
            "composable_node_descriptions": inside,
        }

    def load(self, entity: _Entity) -> tuple[str, dict[str, Any]]:
        _, made = self.container(entity)
        return "LoadComposableNodes", made | {"target_container": self._text(entity.get("target"))}

    def _node(self, entity: _Entity) -> dict[str, Any]:
        found: dict[str, Any] = {
            "name": self._text(entity.get("name")),
            "package": self._text(entity.get("pkg")),
            "plugin": self._text(entity.get("plugin")),
            "namespace": self._text(entity.get("namespace")),
            "remappings": [
                (self._text(each.get("from")), self._text(each.get("to")))
                for each in entity.all("remap")
            ],
        }
        parameters: list[Any] = []
        for each in entity.all("param"):
            if "from" in each.values:
                parameters.append(self._text(each.get("from")))
            else:
                parameters.append({self._text(each.get("name")): self._value(each)})
        found["parameters"] = parameters
        return found

    def _value(self, entity: _Entity) -> Any:
        if entity.children:
            return {self._text(each.get("name")): self._value(each) for each in entity.all("param")}
        value = entity.values.get("value", "")
        if not isinstance(value, str):
            return value
        text = self._text(value)
        if not isinstance(text, str):
            return text
        try:
            plain = resolve(text)
        except ScalarError:
            return text
        return plain if isinstance(plain, bool | int | float) else text

    def executable(self, entity: _Entity) -> tuple[str, dict[str, Any]]:
        command = [self._text(each) for each in _WORD.findall(entity.get("cmd"))]
        return "ExecuteProcess", {"cmd": command, "name": self._text(entity.get("name"))}

    def group(self, entity: _Entity) -> tuple[str, dict[str, Any]]:
        return "GroupAction", {"actions": self.actions(entity.children)}

    def include(self, entity: _Entity) -> tuple[str, dict[str, Any]]:
        given = [*entity.all("arg"), *entity.all("let")]
        arguments = {
            self._text(each.get("name")): self._launch_text(each.get("value")) for each in given
        }
        file = self._text(entity.get("file"))
        return "IncludeLaunchDescription", {
            "launch_description_source": file,
            "launch_arguments": arguments,
        }

    def _launch_text(self, text: str) -> Any:
        value = self._text(text)
        return LaunchText(value) if isinstance(value, str) else value

    def remap(self, entity: _Entity) -> tuple[str, dict[str, Any]]:
        source, target = self._text(entity.get("from")), self._text(entity.get("to"))
        return "SetRemap", {"src": source, "dst": target}

    def namespace(self, entity: _Entity) -> tuple[str, dict[str, Any]]:
        return "PushRosNamespace", {"namespace": self._text(entity.get("namespace"))}

    def _text(self, text: str) -> Any:
        """A text with its references replaced; unknown if the value of one is not known."""
        found = substituted(text, self.values)
        if found is None:
            return Unknown(f"the value of {text} is not known", self.place)
        return found


_MAKERS = {
    "node": _Markup.node,
    "node_container": _Markup.container,
    "load_composable_node": _Markup.load,
    "executable": _Markup.executable,
    "group": _Markup.group,
    "include": _Markup.include,
    "set_remap": _Markup.remap,
    "push_ros_namespace": _Markup.namespace,
    "push_namespace": _Markup.namespace,
}
