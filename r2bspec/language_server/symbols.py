"""The names that a spec defines and uses, with every place: variables, topics, nodes and others.

From these places follow going to a definition, finding references, and renaming. Python files that
a spec names are read without importing them.
"""

from __future__ import annotations

import ast
import posixpath
import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path as FilePath
from typing import Final, Literal

from r2bspec.check.installed_packages import python_target
from r2bspec.diagnostics import Path, Span
from r2bspec.errors import R2bspecError
from r2bspec.exit_status import ExitStatus
from r2bspec.language.document import Source, inner_span
from r2bspec.language.located_tree import ListNode, MapNode, ScalarNode, TreeNode, child, lookup
from r2bspec.language.variables import Reference, references
from r2bspec.language_server.analysis import Analysis
from r2bspec.language_server.positions import place_at
from r2bspec.safe_io.safe_file import RefusedFileError, read_text
from r2bspec.wiring.name_resolution import expand
from r2bspec.wiring.wiring import Endpoint, PhaseWiring

SymbolKind = Literal["variable", "topic", "node", "container", "monitor"]

_METRIC: Final = re.compile(r"\s*([A-Za-z][A-Za-z0-9_]*)(?:\.([A-Za-z][A-Za-z0-9_]*))?")
_PROCESS_FAMILIES: Final = ("cpu", "memory")


@dataclass(frozen=True, slots=True)
class Symbol:
    """A name of a spec; of a topic the full name."""

    kind: SymbolKind
    name: str


@dataclass(frozen=True, slots=True)
class Occurrence:
    """One place of a symbol.

    Attributes:
        span: of the name alone.
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
    """Every place of every symbol, in the document and the files that it extends."""
    found = [*_written_names(analysis), *_topics(analysis)]
    return tuple(dict.fromkeys(found))


def occurrence_at(analysis: Analysis, line: int, column: int) -> Occurrence | None:
    """The symbol at a place of the document, counted as by `Span`."""
    here = [
        each
        for each in occurrences(analysis)
        if each.span.file == str(analysis.path)
        and each.span.line == line == each.span.end_line
        and each.span.column <= column <= each.span.end_column
    ]
    return min(here, key=lambda each: each.span.end_column - each.span.column, default=None)


def places_of(analysis: Analysis, symbol: Symbol) -> list[Occurrence]:
    """Every place of one symbol, definitions first."""
    found = [each for each in occurrences(analysis) if each.symbol == symbol]
    return sorted(found, key=lambda each: not each.is_definition)


def names_of(analysis: Analysis, kind: SymbolKind) -> list[str]:
    """The names of all symbols of a kind that are defined, or, of topics, used."""
    found = (
        each.symbol.name
        for each in occurrences(analysis)
        if each.symbol.kind == kind and (each.is_definition or kind == "topic")
    )
    return list(dict.fromkeys(found))


@dataclass(frozen=True, slots=True)
class _Definitions:
    """The names that all files together define."""

    variables: frozenset[str]
    monitors: frozenset[str]
    containers: frozenset[str]
    nodes: frozenset[str]


def _written_names(analysis: Analysis) -> Iterator[Occurrence]:
    trees = analysis.written
    defined = _Definitions(
        _keys(trees.values(), ("variables",)),
        _keys(trees.values(), ("monitors",)),
        _keys(trees.values(), ("containers",)),
        _keys(trees.values(), ("graph", "nodes")) | _keys(trees.values(), ("preprocessors",)),
    )
    for file, tree in trees.items():
        source = analysis.sources.get(file)
        if source is not None and not file.startswith("--"):
            yield from _names_in(tree, (), source, defined)


def _keys(trees: Iterable[TreeNode], path: Path) -> frozenset[str]:
    found: set[str] = set()
    for tree in trees:
        node = lookup(tree, path)
        found.update(node.entries if isinstance(node, MapNode) else ())
    return frozenset(found)


def _names_in(
    node: TreeNode, path: Path, source: Source, defined: _Definitions
) -> Iterator[Occurrence]:
    if isinstance(node, ScalarNode):
        yield from _in_scalar(node, path, source, defined)
    elif isinstance(node, ListNode):
        for index, item in enumerate(node.items):
            yield from _names_in(item, (*path, index), source, defined)
    elif isinstance(node, MapNode):
        for key, entry in node.entries.items():
            yield from _in_key(key, entry.key_span, path, source, defined)
            yield from _names_in(entry.value, (*path, key), source, defined)


def _in_key(
    key: str, span: Span, path: Path, source: Source, defined: _Definitions
) -> Iterator[Occurrence]:
    kinds: dict[Path, SymbolKind] = {
        ("variables",): "variable",
        ("monitors",): "monitor",
        ("containers",): "container",
        ("graph", "nodes"): "node",
        ("preprocessors",): "node",
    }
    if path in kinds:
        yield Occurrence(Symbol(kinds[path], key), span, key, is_definition=True)
    elif key in defined.variables and (path[:1] == ("matrix",) or path[-1:] == ("when",)):
        yield Occurrence(Symbol("variable", key), span, key)
    yield from _references(key, span, source)


def _in_scalar(
    node: ScalarNode, path: Path, source: Source, defined: _Definitions
) -> Iterator[Occurrence]:
    yield from _references(node.text, node.span, source)
    if path[-1:] == ("container",):
        if node.text in defined.containers:
            yield Occurrence(Symbol("container", node.text), node.span, node.text)
    elif path[:1] == ("slos",) or "holds" in path:
        yield from _in_requirement(node, source, defined)


def _references(text: str, span: Span, source: Source) -> Iterator[Occurrence]:
    for each in references(text):
        if isinstance(each, Reference) and each.kind == "var":
            place = inner_span(source, span, text, each.name_start, len(each.name))
            yield Occurrence(Symbol("variable", each.name), place, each.name)


def _in_requirement(
    node: ScalarNode, source: Source, defined: _Definitions
) -> Iterator[Occurrence]:
    match = _METRIC.match(node.text)
    if match is None:
        return
    first, second = match[1], match[2]
    if first in defined.monitors and second:
        place = inner_span(source, node.span, node.text, match.start(1), len(first))
        yield Occurrence(Symbol("monitor", first), place, first)
    elif first in _PROCESS_FAMILIES and second:
        place = inner_span(source, node.span, node.text, match.start(2), len(second))
        if second in defined.nodes:
            yield Occurrence(Symbol("node", second), place, second)
        elif second in defined.containers:
            yield Occurrence(Symbol("container", second), place, second)


def _topics(analysis: Analysis) -> Iterator[Occurrence]:
    context = analysis.context
    if context is None or context.loaded.tree is None:
        return
    for phase in context.wiring.phases:
        for endpoint in phase.endpoints:
            made = _topic(endpoint, phase, context.loaded.tree, context.wiring.namespace)
            if made is not None:
                yield made


def _topic(endpoint: Endpoint, phase: PhaseWiring, tree: TreeNode, outer: str) -> Occurrence | None:
    """The place of an endpoint's topic; None where the code of the node decides its name."""
    node = phase.node(endpoint.owner)
    namespace = node.namespace if node is not None else outer
    written, span = _written_topic(tree, endpoint)
    if (
        span is None
        or expand(written, node.key if node is not None else "", namespace) != endpoint.topic
    ):
        return None
    symbol = Symbol("topic", endpoint.topic)
    return Occurrence(symbol, span, written, endpoint.is_publisher, namespace)


def _written_topic(tree: TreeNode, endpoint: Endpoint) -> tuple[str, Span | None]:
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
    """A name that cannot be changed, or not to this one."""

    code = "R2B602"
    exit_code = ExitStatus.USAGE


def definitions(analysis: Analysis, line: int, column: int) -> list[Span]:
    """Where what is at a place is defined: a name, an extended file, or a Python class."""
    occurrence = occurrence_at(analysis, line, column)
    if occurrence is not None:
        found = places_of(analysis, occurrence.symbol)
        return [each.span for each in found if each.is_definition]
    tree = analysis.written.get(str(analysis.path))
    place = place_at(tree, str(analysis.path), line, column) if tree is not None else None
    node = lookup(tree, place.path) if tree is not None and place is not None else None
    if place is None or place.is_key or not isinstance(node, ScalarNode):
        return []
    if place.path[0] == "extends":
        return [Span.of_file(_beside(analysis, node.text))]
    if place.path[-1] == "python":
        return list(_class_definition(analysis, node.text))
    return []


def references_at(
    analysis: Analysis, line: int, column: int, *, with_definition: bool
) -> list[Occurrence]:
    """Every place of the name at a place."""
    occurrence = occurrence_at(analysis, line, column)
    if occurrence is None:
        return []
    found = places_of(analysis, occurrence.symbol)
    return [each for each in found if with_definition or not each.is_definition]


def rename(analysis: Analysis, line: int, column: int, new_name: str) -> dict[Span, str]:
    """The new text of every place of the name at a place.

    Raises:
        RenameError: there is no name, the new one is not possible or taken, or a place cannot be
            edited.
    """
    occurrence = renamable(analysis, line, column)
    symbol = occurrence.symbol
    if symbol.kind != "topic":
        if not _NAME.match(new_name):
            raise RenameError(f"'{new_name}' is no name: use letters, digits and underscores")
        if places_of(analysis, Symbol(symbol.kind, new_name)):
            raise RenameError(f"there is already a {symbol.kind} '{new_name}'")
        return {each.span: new_name for each in places_of(analysis, symbol)}
    if not _TOPIC.match(new_name):
        raise RenameError(f"'{new_name}' is no topic: use letters, digits, underscores and '/'")
    full = expand(new_name, "", occurrence.namespace)
    if full != symbol.name and places_of(analysis, Symbol("topic", full)):
        raise RenameError(f"there is already a topic {full}")
    return {each.span: _as_written(each, full) for each in places_of(analysis, symbol)}


def renamable(analysis: Analysis, line: int, column: int) -> Occurrence:
    """The name at a place.

    Raises:
        RenameError: there is none, or one of its places cannot be edited.
    """
    occurrence = occurrence_at(analysis, line, column)
    if occurrence is None:
        raise RenameError("no name that can be changed is here")
    if occurrence.symbol.kind == "topic":
        _check_topic(analysis, occurrence.symbol)
    for each in places_of(analysis, occurrence.symbol):
        if each.span.file.startswith(("--", "$")):
            raise RenameError(f"'{each.text}' comes from an option or the environment")
    return occurrence


def _check_topic(analysis: Analysis, symbol: Symbol) -> None:
    places = {each.span for each in places_of(analysis, symbol)}
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
    """The new name in the form of the old one: absolute, or relative to the same namespace."""
    inside = f"{place.namespace.rstrip('/')}/"
    if not place.text.startswith("/") and full.startswith(inside):
        return full.removeprefix(inside)
    return full


def _beside(analysis: Analysis, text: str) -> str:
    return posixpath.normpath(posixpath.join(analysis.path.parent.as_posix(), text))


def _class_definition(analysis: Analysis, text: str) -> Iterator[Span]:
    """The class of a Python node in a file next to the spec; the file is read, not imported."""
    target = python_target(text, analysis.path.parent)
    if target.module or not target.readable:
        return
    file = str(FilePath(posixpath.normpath(target.file.as_posix())))
    found = definitions_in(target.file)
    if found is None:
        return
    for each in found:
        if each.name == target.name:
            column = each.col_offset + 1
            yield Span(file, each.lineno, column, each.lineno, column + len(each.name))
            return
    yield Span.of_file(file)


_MAX_PYTHON_BYTES: Final = 2_000_000


def definitions_in(file: FilePath) -> tuple[ast.ClassDef | ast.FunctionDef, ...] | None:
    """The classes and functions at the top of a file; None if it cannot be read or parsed."""
    try:
        module = ast.parse(read_text(file, max_bytes=_MAX_PYTHON_BYTES))
    except (OSError, RefusedFileError, SyntaxError, ValueError, RecursionError, MemoryError):
        return None
    return tuple(each for each in module.body if isinstance(each, ast.ClassDef | ast.FunctionDef))
