"""Positions in a text, of the compiler and of the protocol, and what is written there.

The compiler counts lines as YAML does and columns in characters, both from 1. The protocol counts
from 0, its lines end only with a carriage return or a line feed, and its columns are in the units
of the negotiated encoding: UTF-16 code units by default. An offset is in characters.
"""

from __future__ import annotations

import re
from bisect import bisect_right
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Final

from lsprotocol import types

from r2bspec.diagnostics import Path, Span
from r2bspec.diagnostics.diagnostic import LINE_BREAK
from r2bspec.language.located_tree import ListNode, MapNode, TreeNode

_PROTOCOL_LINE_BREAK: Final = re.compile(r"\r\n|\n|\r")

_UNITS: Final[Mapping[str, Callable[[str], int]]] = {
    "utf-8": lambda character: len(character.encode("utf-8", "surrogatepass")),
    "utf-16": lambda character: 1 + (ord(character) > 0xFFFF),
    "utf-32": lambda _: 1,
}


class TextPositions:
    """The positions in one text.

    Args:
        text: of the document.
        encoding: of the protocol's columns: ``utf-8``, ``utf-16`` or ``utf-32``.
    """

    def __init__(self, text: str, encoding: str = "utf-16") -> None:
        self.text = text
        self._units = _UNITS[encoding]
        # The compiler skips a byte-order mark, editors keep it.
        self._skipped = 1 if text.startswith("\ufeff") else 0
        read = text[self._skipped :]
        self._yaml_starts = _line_starts(LINE_BREAK, read, self._skipped)
        self._starts = _line_starts(_PROTOCOL_LINE_BREAK, text, 0)

    def offset_of_place(self, line: int, column: int) -> int:
        """The offset of a place of the compiler; beyond the text, that of the nearest character."""
        if line > len(self._yaml_starts):
            return len(self.text)
        return min(self._yaml_starts[max(line, 1) - 1] + column - 1, len(self.text))

    def place_of_offset(self, offset: int) -> tuple[int, int]:
        """The line and the column, as the compiler counts them."""
        line = bisect_right(self._yaml_starts, max(offset, self._skipped))
        return line, offset - self._yaml_starts[line - 1] + 1

    def offset(self, position: types.Position) -> int:
        """The offset of a position of the protocol; beyond its line, that of the line's end."""
        if position.line >= len(self._starts):
            return len(self.text)
        offset = self._starts[position.line]
        end = self._line_end(position.line)
        left = position.character
        while offset < end and left > 0:
            left -= self._units(self.text[offset])
            offset += 1
        return offset

    def position(self, offset: int) -> types.Position:
        """The position of the protocol at an offset."""
        line = bisect_right(self._starts, offset) - 1
        before = self.text[self._starts[line] : offset]
        return types.Position(line, sum(map(self._units, before)))

    def range(self, span: Span) -> types.Range:
        """The range of a span."""
        return self.range_of_offsets(*self.offsets(span))

    def range_of_offsets(self, start: int, end: int) -> types.Range:
        """The range between two offsets."""
        return types.Range(self.position(start), self.position(end))

    def offsets(self, span: Span) -> tuple[int, int]:
        """The offsets of a span: its first character, and the one after its last."""
        return (
            self.offset_of_place(span.line, span.column),
            self.offset_of_place(span.end_line, span.end_column),
        )

    def line_at(self, offset: int) -> tuple[int, int]:
        """The offsets of the beginning and the end, without its break, of the line at an offset."""
        line = bisect_right(self._starts, offset) - 1
        return self._starts[line], self._line_end(line)

    def _line_end(self, line: int) -> int:
        end = self._starts[line + 1] if line + 1 < len(self._starts) else len(self.text)
        return self._starts[line] + len(self.text[self._starts[line] : end].rstrip("\r\n"))


def _line_starts(line_break: re.Pattern[str], text: str, first: int) -> list[int]:
    return [first, *(first + match.end() for match in line_break.finditer(text))]


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
    found = _find_place(tree, (), file, (line, column), ())
    return found if found is None or found.path else None


def contains(span: Span, file: str, place: tuple[int, int]) -> bool:
    """Whether a span contains a line and a column; its end counts."""
    start, end = (span.line, span.column), (span.end_line, span.end_column)
    return span.file == file and start <= place <= end


def _find_place(
    node: TreeNode, path: Path, file: str, place: tuple[int, int], parents: tuple[Span, ...]
) -> Place | None:
    inner = (node.span, *parents)
    if isinstance(node, MapNode):
        for key, entry in node.entries.items():
            if contains(entry.key_span, file, place):
                return Place((*path, key), entry.key_span, is_key=True, parents=inner)
            below = _find_place(entry.value, (*path, key), file, place, inner)
            if below is not None:
                return below
    elif isinstance(node, ListNode):
        for index, item in enumerate(node.items):
            below = _find_place(item, (*path, index), file, place, inner)
            if below is not None:
                return below
    if not contains(node.span, file, place):
        return None
    return Place(path, node.span, is_key=False, parents=parents)
