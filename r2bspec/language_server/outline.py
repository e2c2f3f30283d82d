"""The structure of a document for an editor: symbols, folding, and growing selections."""

from __future__ import annotations

from collections.abc import Iterator

from lsprotocol import types

from r2bspec.diagnostics import Path, Span
from r2bspec.language.located_tree import ListNode, MapNode, ScalarNode, TreeNode
from r2bspec.language_server.places import place_at
from r2bspec.language_server.text_positions import TextPositions

_MAX_DEPTH = 5
_KINDS: dict[Path, types.SymbolKind] = {
    ("variables",): types.SymbolKind.Variable,
    ("graph", "nodes"): types.SymbolKind.Class,
    ("preprocessors",): types.SymbolKind.Class,
    ("containers",): types.SymbolKind.Module,
    ("monitors",): types.SymbolKind.Event,
    ("slos",): types.SymbolKind.Interface,
    ("playback", "inputs"): types.SymbolKind.Event,
}
"""Kinds of the entries of a map of names."""


def document_symbols(tree: TreeNode, positions: TextPositions) -> list[types.DocumentSymbol]:
    """The keys of a document, nested as they are."""
    return list(_symbols(tree, (), positions))


def _symbols(
    node: TreeNode, path: Path, positions: TextPositions
) -> Iterator[types.DocumentSymbol]:
    if not isinstance(node, MapNode) or len(path) >= _MAX_DEPTH:
        return
    for key, entry in node.entries.items():
        value = entry.value
        own = entry.key_span
        if not _is_after(value.span, own):
            # The value of an alias is written elsewhere.
            whole = own
        else:
            whole = Span(own.file, own.line, own.column, value.span.end_line, value.span.end_column)
        yield types.DocumentSymbol(
            name=key or "''",
            detail=value.text[:60] if isinstance(value, ScalarNode) else None,
            kind=_KINDS.get(path, _kind(value)),
            range=positions.range(whole),
            selection_range=positions.range(own),
            children=list(_symbols(value, (*path, key), positions)),
        )


def _kind(value: TreeNode) -> types.SymbolKind:
    if isinstance(value, MapNode):
        return types.SymbolKind.Object
    return types.SymbolKind.Array if isinstance(value, ListNode) else types.SymbolKind.Property


def _is_after(span: Span, other: Span) -> bool:
    return span.file == other.file and (span.line, span.column) >= (other.line, other.column)


def folding_ranges(tree: TreeNode, positions: TextPositions) -> list[types.FoldingRange]:
    """Every key whose value has several lines, and every block of comments."""
    found = [*_folds(tree, positions), *_comment_folds(positions.text)]
    return [each for each in found if each.end_line > each.start_line]


def _folds(node: TreeNode, positions: TextPositions) -> Iterator[types.FoldingRange]:
    if isinstance(node, MapNode):
        for entry in node.entries.values():
            if _is_after(entry.value.span, entry.key_span):
                start = positions.range(entry.key_span).start.line
                yield types.FoldingRange(start, positions.range(entry.value.span).end.line)
            yield from _folds(entry.value, positions)
    elif isinstance(node, ListNode):
        for item in node.items:
            where = positions.range(item.span)
            yield types.FoldingRange(where.start.line, where.end.line)
            yield from _folds(item, positions)


def _comment_folds(text: str) -> Iterator[types.FoldingRange]:
    start: int | None = None
    lines = text.split("\n")
    for number, line in enumerate([*lines, ""]):
        if line.lstrip().startswith("#"):
            start = number if start is None else start
        elif start is not None:
            yield types.FoldingRange(start, number - 1, kind=types.FoldingRangeKind.Comment)
            start = None


def selection_range(
    tree: TreeNode, file: str, positions: TextPositions, position: types.Position
) -> types.SelectionRange:
    """The innermost value at a position, in what contains it, up to the whole document."""
    line, column = positions.place_of_offset(positions.offset(position))
    place = place_at(tree, file, line, column)
    whole = positions.range_of_offsets(0, len(positions.text))
    selection = types.SelectionRange(whole)
    spans = (place.span, *place.parents) if place is not None else ()
    for span in reversed(spans):
        inner = positions.range(span)
        if inner != selection.range:
            selection = types.SelectionRange(inner, selection)
    return selection
