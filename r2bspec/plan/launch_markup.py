"""Launch files in XML and YAML as entities, which both notations have.

A document type, with which XML declares entities that expand, is refused by the parser itself.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final
from xml.parsers import expat

import yaml

from r2bspec.diagnostics import Span
from r2bspec.safe_io.limits import MAX_MARKUP_DEPTH
from r2bspec.safe_io.safe_yaml import load_values

_CHILDREN: Final = frozenset(
    {
        *("param", "remap", "env", "extra_arg", "composable_node"),
        *("arg", "let", "node", "group", "include", "choice"),
    }
)


class MarkupError(ValueError):
    """A text that is no launch file in XML or YAML, and its place."""

    def __init__(self, message: str, file: Path, line: int = 1, column: int = 1) -> None:
        super().__init__(message)
        self.span = Span(str(file), line, column, line, column + 1)


@dataclass(slots=True)
class Entity:
    """A name with attributes, and entities inside."""

    name: str
    place: Span
    values: dict[str, Any] = field(default_factory=dict)
    children: list[Entity] = field(default_factory=list)

    def all(self, name: str) -> list[Entity]:
        """Those of this name that are directly inside."""
        return [child for child in self.children if child.name == name]

    def below(self) -> Iterator[Entity]:
        """All that are inside, in order."""
        for child in self.children:
            yield child
            yield from child.below()

    def get(self, *names: str) -> str:
        """The text of the first of these attributes that is there; empty without one."""
        for name in names:
            value = self.values.get(name)
            if isinstance(value, str | int | float | bool):
                return str(value)
        return ""


def read_markup(text: str, file: Path) -> Entity:
    """The entity that a launch file in XML or YAML is.

    Raises:
        MarkupError: it cannot be parsed.
    """
    is_xml = text.lstrip().startswith("<") or (file.suffix == ".xml" and not text.strip())
    return _xml(file, text) if is_xml else _yaml(file, text)


def _xml(file: Path, text: str) -> Entity:
    parser = expat.ParserCreate(namespace_separator="}")
    path = [Entity("", Span.of_file(str(file)))]

    def doctype(*_: object) -> None:
        line, column = parser.CurrentLineNumber, parser.CurrentColumnNumber + 1
        reason = "declarations (<!DOCTYPE>, <!ENTITY>) are refused"
        raise MarkupError(reason, file, line, column)

    def start(name: str, attributes: dict[str, str]) -> None:
        if len(path) > MAX_MARKUP_DEPTH + 1:
            raise MarkupError(f"entities are nested more than {MAX_MARKUP_DEPTH} times", file)
        line, column = parser.CurrentLineNumber, parser.CurrentColumnNumber + 1
        place = Span(str(file), line, column, line, column + len(name) + 1)
        values = {key.replace("-", "_"): value for key, value in attributes.items()}
        entity = Entity(name.replace("-", "_"), place, values)
        path[-1].children.append(entity)
        path.append(entity)

    parser.StartDoctypeDeclHandler = doctype
    parser.StartElementHandler = start
    parser.EndElementHandler = lambda _: path.pop()
    try:
        parser.Parse(text, True)
    except expat.ExpatError as error:
        reason = f"invalid XML: {error}"
        raise MarkupError(reason, file, error.lineno, error.offset + 1) from error
    return path[0].children[0]


def _yaml(file: Path, text: str) -> Entity:
    try:
        content = load_values(text)
        root = yaml.compose(text, Loader=getattr(yaml, "CSafeLoader", yaml.SafeLoader))
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        line, column = (mark.line + 1, mark.column + 1) if mark is not None else (1, 1)
        reason = f"invalid YAML: {error}".split("\n")[0]
        raise MarkupError(reason, file, line, column) from error
    if not isinstance(content, dict) or not isinstance(content.get("launch"), list):
        raise MarkupError("a launch file in YAML has a list under the key 'launch'", file)
    inside = [*_listed(str(file), *_entries(content, root)["launch"], 0)]
    return Entity("launch", Span.of_file(str(file)), {}, inside)


def _listed(file: str, items: Any, node: Any, depth: int) -> Iterator[Entity]:
    """The entities of a list of values, with the places of the nodes that these are made of."""
    for values, at in _pairs(items, node) if depth < MAX_MARKUP_DEPTH else ():
        for name, (value, below) in _entries(values, at).items():
            yield _entity(file, name, value, below, depth)


def _entity(file: str, name: str, values: Any, node: Any, depth: int) -> Entity:
    line, column = node.start_mark.line + 1, node.start_mark.column + 1
    entity = Entity(name.replace("-", "_"), Span(file, line, column, line, column + 1))
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
