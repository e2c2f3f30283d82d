"""The names that a spec defines and uses, with every place: variables, topics, nodes and others.

Going to a definition, finding references, and renaming use these places. Python files that a spec
names are read without importing them.
"""

from __future__ import annotations

import ast
import posixpath
import re
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path as FilePath
from typing import Final, Literal

from r2bspec.diagnostics import Path, Span
from r2bspec.errors import ExitStatus, R2bspecError
from r2bspec.language.document import Source, inner_span
from r2bspec.language.located_tree import MapNode, ScalarNode, TreeNode, child, lookup
from r2bspec.language.variables import Reference, references
from r2bspec.language_server.analysis import Analysis
from r2bspec.language_server.positions import place_at, walk
from r2bspec.plan.installed_packages import python_target
from r2bspec.plan.wiring.name_resolution import expand
from r2bspec.plan.wiring.python_files import read_python_file
from r2bspec.plan.wiring.wiring import WiredEndpoint

SymbolKind = Literal["variable", "topic", "node", "container", "monitor"]

_METRIC: Final = re.compile(r"\s*([A-Za-z][A-Za-z0-9_]*)(?:\.([A-Za-z][A-Za-z0-9_]*))?")
_PROCESS_FAMILIES: Final = ("cpu", "memory")


@dataclass(frozen=True, slots=True)
class Symbol:
    """A name of a spec; for a topic the full name."""

    kind: SymbolKind
    name: str


@dataclass(frozen=True, slots=True)
class Occurrence:
    """A place of a symbol.

    Attributes:
        span: the span of the name alone.
        text: the name as it is written there; of a topic it may be relative.
        is_definition: whether the spec defines the symbol here.
        namespace: to which a relative topic is relative.
    """

    symbol: Symbol
    span: Span
    text: str
    is_definition: bool = False
    namespace: str = ""


def occurrences(analysis: Analysis) -> tuple[Occurrence, ...]:
    """Return every place of every symbol, in the document and the files that it extends."""
    names = [*_written_names(analysis), *_topics(analysis)]
    return tuple(dict.fromkeys(names))


def occurrence_at(analysis: Analysis, place: tuple[int, int]) -> Occurrence | None:
    """Return the symbol at a line and a column of the document, counted as by `Span`."""
    line, column = place
    here = [
        occurrence
        for occurrence in occurrences(analysis)
        if (span := occurrence.span).file == str(analysis.path)
        and span.line == line == span.end_line
        and span.column <= column <= span.end_column
    ]
    return min(here, key=lambda each: each.span.end_column - each.span.column, default=None)


def places_of(analysis: Analysis, symbol: Symbol) -> list[Occurrence]:
    """Return every place of a symbol, definitions first."""
    places = [occurrence for occurrence in occurrences(analysis) if occurrence.symbol == symbol]
    return sorted(places, key=lambda each: not each.is_definition)


def names_of(analysis: Analysis, kind: SymbolKind) -> list[str]:
    """Return the names of all symbols of a kind that are defined."""
    defined = (
        occurrence.symbol for occurrence in occurrences(analysis) if occurrence.is_definition
    )
    return list(dict.fromkeys(symbol.name for symbol in defined if symbol.kind == kind))


_DEFINED: Final[Mapping[Path, SymbolKind]] = {
    ("variables",): "variable",
    ("monitors",): "monitor",
    ("playback", "calls"): "monitor",
    ("containers",): "container",
    ("graph", "nodes"): "node",
    ("preprocessors",): "node",
}
"""The maps whose keys are names that a spec defines."""


def _written_names(analysis: Analysis) -> Iterator[Occurrence]:
    defined: set[Symbol] = set()
    for tree in analysis.written.values():
        for path, kind in _DEFINED.items():
            node = lookup(tree, path)
            names = node.entries if isinstance(node, MapNode) else ()
            defined |= {Symbol(kind, name) for name in names}
    for file, tree in analysis.written.items():
        source = analysis.sources[file]
        if file.startswith("--"):
            continue
        for path, key_span, node in walk(tree):
            if key_span is not None:
                yield from _in_key(path, key_span, source, defined)
            if isinstance(node, ScalarNode):
                yield from _in_scalar(node, path, source, defined)


def _in_key(
    path: Path, span: Span, source: Source, defined: Collection[Symbol]
) -> Iterator[Occurrence]:
    owner, key = path[:-1], str(path[-1])
    is_set = owner[:1] == ("matrix",) or owner[-1:] == ("when",)
    if owner in _DEFINED:
        yield Occurrence(Symbol(_DEFINED[owner], key), span, key, is_definition=True)
    elif is_set and (variable := Symbol("variable", key)) in defined:
        yield Occurrence(variable, span, key)
    yield from _references(key, span, source)


def _in_scalar(
    node: ScalarNode, path: Path, source: Source, defined: Collection[Symbol]
) -> Iterator[Occurrence]:
    yield from _references(node.text, node.span, source)
    if path[-1:] == ("container",):
        if (container := Symbol("container", node.text)) in defined:
            yield Occurrence(container, node.span, node.text)
    elif path[:1] == ("slos",) or "holds" in path:
        yield from _in_requirement(node, source, defined)


def _references(text: str, span: Span, source: Source) -> Iterator[Occurrence]:
    for reference in references(text):
        if isinstance(reference, Reference) and reference.kind == "var":
            place = inner_span(source, span, text, reference.name_start, len(reference.name))
            yield Occurrence(Symbol("variable", reference.name), place, reference.name)


def _in_requirement(
    node: ScalarNode, source: Source, defined: Collection[Symbol]
) -> Iterator[Occurrence]:
    """Yield the monitor before a metric, or the process after a family of metrics."""
    match = _METRIC.match(node.text)
    if match is None or not match[2]:
        return
    possible = [(1, Symbol("monitor", match[1]))]
    if match[1] in _PROCESS_FAMILIES:
        possible += [(2, Symbol("node", match[2])), (2, Symbol("container", match[2]))]
    group, symbol = next(
        (candidate for candidate in possible if candidate[1] in defined), (0, None)
    )
    if symbol is not None:
        place = inner_span(source, node.span, node.text, match.start(group), len(symbol.name))
        yield Occurrence(symbol, place, symbol.name)


def _topics(analysis: Analysis) -> Iterator[Occurrence]:
    """Yield the places of topics, but for those of which the code of a node decides the name."""
    context = analysis.context
    if context is None or context.loaded.tree is None:
        return
    for phase in context.wiring.phases:
        for end in phase.endpoints:
            node = phase.node(end.owner)
            namespace = node.namespace if node is not None else context.wiring.namespace
            text, span = _written_topic(context.loaded.tree, end)
            full = expand(text, node.key if node is not None else "", namespace)
            if span is not None and full == end.topic:
                symbol = Symbol("topic", end.topic)
                yield Occurrence(symbol, span, text, end.is_publisher, namespace)


def _written_topic(tree: TreeNode, endpoint: WiredEndpoint) -> tuple[str, Span | None]:
    if endpoint.topic_is_key and endpoint.path:
        owner = lookup(tree, endpoint.path[:-1])
        name = str(endpoint.path[-1])
        if isinstance(owner, MapNode) and name in owner.entries:
            return name, owner.entries[name].key_span
        return "", None
    value = lookup(tree, endpoint.path)
    if isinstance(value, MapNode):
        value = child(value, "topic")
    if isinstance(value, ScalarNode) and value.origin is None:
        return value.text, value.span
    return "", None


_NAME: Final = re.compile(r"[A-Za-z_][A-Za-z0-9_]*\Z")
_TOPIC: Final = re.compile(r"/?[A-Za-z_][A-Za-z0-9_]*(?:/[A-Za-z_][A-Za-z0-9_]*)*\Z")


class RenameError(R2bspecError):
    """The name cannot be changed, or not to this name."""

    code = "R2B602"
    exit_code = ExitStatus.USAGE


def references_at(analysis: Analysis, place: tuple[int, int]) -> list[Occurrence]:
    """Return every place of the name at a line and a column."""
    occurrence = occurrence_at(analysis, place)
    return places_of(analysis, occurrence.symbol) if occurrence is not None else []


def definitions(analysis: Analysis, place: tuple[int, int]) -> list[Span]:
    """Return where the name at a place is defined: a key, an extended file, or a Python class."""
    if named := references_at(analysis, place):
        return [occurrence.span for occurrence in named if occurrence.is_definition]
    tree = analysis.tree
    value = place_at(tree, str(analysis.path), place) if tree is not None else None
    node = lookup(tree, value.path) if value is not None else None
    if value is None or value.is_key or not isinstance(node, ScalarNode):
        return []
    folder = analysis.path.parent
    if value.path[0] == "extends":
        return [Span.of_file(posixpath.normpath(posixpath.join(folder.as_posix(), node.text)))]
    return list(_class_definition(folder, node.text)) if value.path[-1] == "python" else []


def rename(analysis: Analysis, place: tuple[int, int], new_name: str) -> dict[Span, str]:
    """Return the new text of every place of the name at a place.

    Raises:
        RenameError: there is no name, the new one is not possible or taken, or a place cannot be
            edited.
    """
    occurrence = renamable(analysis, place)
    symbol = occurrence.symbol
    if symbol.kind != "topic":
        if not _NAME.match(new_name):
            raise RenameError(f"'{new_name}' is no name: use letters, digits and underscores")
        if places_of(analysis, Symbol(symbol.kind, new_name)):
            raise RenameError(f"there is already a {symbol.kind} '{new_name}'")
        return {occurrence_place.span: new_name for occurrence_place in places_of(analysis, symbol)}
    if not _TOPIC.match(new_name):
        raise RenameError(f"'{new_name}' is no topic: use letters, digits, underscores and '/'")
    full = expand(new_name, "", occurrence.namespace)
    if full != symbol.name and places_of(analysis, Symbol("topic", full)):
        raise RenameError(f"there is already a topic {full}")
    return {
        occurrence_place.span: _as_written(occurrence_place, full)
        for occurrence_place in places_of(analysis, symbol)
    }


def renamable(analysis: Analysis, place: tuple[int, int]) -> Occurrence:
    """Return the name at a place.

    Raises:
        RenameError: there is none, or one of its places cannot be edited.
    """
    occurrence = occurrence_at(analysis, place)
    if occurrence is None:
        raise RenameError("no name that can be changed is here")
    if occurrence.symbol.kind == "topic":
        _check_topic(analysis, occurrence.symbol)
    for occurrence_place in places_of(analysis, occurrence.symbol):
        if occurrence_place.span.file.startswith(("--", "$")):
            raise RenameError(f"'{occurrence_place.text}' comes from an option or the environment")
    return occurrence


def _check_topic(analysis: Analysis, symbol: Symbol) -> None:
    places = {place.span for place in places_of(analysis, symbol)}
    context = analysis.context
    for phase in context.wiring.phases if context is not None else ():
        for end in (*phase.publishers(symbol.name), *phase.subscriptions(symbol.name)):
            if end.is_node and end.path[-2:-1] != ("remappings",):
                verb = "publishes" if end.is_publisher else "subscribes to"
                raise RenameError(
                    f"{end.owner} {verb} {symbol.name} by the name in its code",
                    hint="add a remapping to the node first",
                )
    if not places:
        raise RenameError(f"{symbol.name} is not written in the spec")


def _as_written(place: Occurrence, full: str) -> str:
    """Return the new name in the form of the old: absolute, or relative to its namespace."""
    inside = f"{place.namespace.rstrip('/')}/"
    if not place.text.startswith("/") and full.startswith(inside):
        return full.removeprefix(inside)
    return full


def _class_definition(folder: FilePath, text: str) -> Iterator[Span]:
    """Yield the class of a Python node in a file next to the spec.

    The file is read, not imported.
    """
    target = python_target(text, folder)
    if target.module or not target.readable:
        return
    file = str(FilePath(posixpath.normpath(target.file.as_posix())))
    module = read_python_file(target.file)
    for node in module.body if module is not None else ():
        if isinstance(node, ast.ClassDef | ast.FunctionDef) and node.name == target.name:
            column = node.col_offset + 1
            yield Span(file, node.lineno, column, node.lineno, column + len(node.name))
            return
    if module is not None:
        yield Span.of_file(file)
