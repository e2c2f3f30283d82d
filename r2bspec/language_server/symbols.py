"""The names that a spec defines and uses, with every place: variables, topics, nodes and others."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Final, Literal

from r2bspec.diagnostics import Path, Span
from r2bspec.language.located_tree import ListNode, MapNode, ScalarNode, TreeNode, child, lookup
from r2bspec.language.source_text import Source, inner_span
from r2bspec.language.variables import Reference, references
from r2bspec.language_server.analysis import Analysis
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
