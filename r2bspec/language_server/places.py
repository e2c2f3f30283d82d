"""What is written at a place of a document: the path of the innermost value or key."""

from __future__ import annotations

from dataclasses import dataclass

from r2bspec.diagnostics import Path, Span
from r2bspec.language.located_tree import ListNode, MapNode, TreeNode


@dataclass(frozen=True, slots=True)
class Place:
    """The innermost key or value at a place.

    Attributes:
        is_key: whether it is the key at `path`, and not its value.
        parents: the spans around it, the innermost first.
    """

    path: Path
    span: Span
    is_key: bool
    parents: tuple[Span, ...]


def place_at(tree: TreeNode, file: str, line: int, column: int) -> Place | None:
    """The innermost key or value at a place; None where there is none, as in a comment."""
    found = _find(tree, (), file, (line, column), ())
    return found if found is None or found.path else None


def contains(span: Span, file: str, place: tuple[int, int]) -> bool:
    """Whether a span contains a line and a column; its end counts."""
    start, end = (span.line, span.column), (span.end_line, span.end_column)
    return span.file == file and start <= place <= end


def _find(
    node: TreeNode, path: Path, file: str, place: tuple[int, int], parents: tuple[Span, ...]
) -> Place | None:
    inner = (node.span, *parents)
    if isinstance(node, MapNode):
        for key, entry in node.entries.items():
            if contains(entry.key_span, file, place):
                return Place((*path, key), entry.key_span, is_key=True, parents=inner)
            below = _find(entry.value, (*path, key), file, place, inner)
            if below is not None:
                return below
    elif isinstance(node, ListNode):
        for index, item in enumerate(node.items):
            below = _find(item, (*path, index), file, place, inner)
            if below is not None:
                return below
    if not contains(node.span, file, place):
        return None
    return Place(path, node.span, is_key=False, parents=parents)
