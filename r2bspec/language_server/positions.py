"""Positions in a text, of the compiler and of the protocol, and the cursor in a document.

The compiler counts lines as YAML does and columns in characters, both from 1. The protocol counts
in the negotiated encoding: UTF-16 code units by default. An offset is in characters.

The cursor may be in a text that is not valid: the word at the cursor is replaced by a marker and
the text is parsed; where the marker is in the tree tells the path, and whether a key or a value is
being written. A text that cannot be parsed with the marker as a value is tried with the marker as a
key, then without what follows the line.
"""

from __future__ import annotations

import itertools
import re
from bisect import bisect_right
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Final

from lsprotocol import types

from r2bspec.diagnostics import Path, Span
from r2bspec.diagnostics.diagnostic import LINE_BREAK
from r2bspec.language.document import Source
from r2bspec.language.located_tree import ListNode, MapNode, ScalarNode, TreeNode
from r2bspec.language.yaml_document import compose

_PROTOCOL_LINE_BREAK: Final = re.compile(r"\r\n|\n|\r")

ENCODINGS: Final[Mapping[str, tuple[str, int]]] = {
    "utf-8": ("utf-8", 1),
    "utf-16": ("utf-16-le", 2),
    "utf-32": ("utf-32-le", 4),
}
"""How the protocol may count characters: the name of the codec, and the bytes of a unit."""


def _units(text: str, encoding: str) -> int:
    """Return the length of a text, as the protocol counts it."""
    if text.isascii():
        return len(text)
    codec, size = ENCODINGS[encoding]
    return len(text.encode(codec, "surrogatepass")) // size


def _characters(line: str, units: int, encoding: str) -> int:
    """Return how many whole characters of a line are within a number of units."""
    before = line[:units]
    if before.isascii():
        return len(before)
    codec, size = ENCODINGS[encoding]
    cut = before.encode(codec, "surrogatepass")[: units * size]
    return len(cut.decode(codec, "ignore"))


class TextPositions:
    """The positions in a text.

    Args:
        text: of the document.
        encoding: the encoding of the protocol's columns: ``utf-8``, ``utf-16`` or ``utf-32``.
    """

    def __init__(self, text: str, encoding: str = "utf-16") -> None:
        self.text = text
        self._encoding = encoding
        # The compiler skips a byte-order mark, editors keep it.
        self._skipped = 1 if text.startswith("\ufeff") else 0

    @cached_property
    def _starts(self) -> list[int]:
        """Where the lines of the protocol begin."""
        return _line_starts(_PROTOCOL_LINE_BREAK, self.text, 0)

    @cached_property
    def _yaml_starts(self) -> list[int]:
        """Where the lines of YAML begin."""
        return _line_starts(LINE_BREAK, self.text[self._skipped :], self._skipped)

    def offset_of_place(self, line: int, column: int) -> int:
        """Return the offset of a place of the compiler.

        Beyond the text, that of the nearest character.
        """
        if line > len(self._yaml_starts):
            return len(self.text)
        return min(self._yaml_starts[max(line, 1) - 1] + column - 1, len(self.text))

    def place(self, position: types.Position) -> tuple[int, int]:
        """Return line and column of a position of the protocol, as the compiler counts them."""
        offset = self.offset(position)
        line = bisect_right(self._yaml_starts, max(offset, self._skipped))
        return line, offset - self._yaml_starts[line - 1] + 1

    def offset(self, position: types.Position) -> int:
        """Return the offset of a position of the protocol.

        Beyond its line, that of the line's end.
        """
        if position.line >= len(self._starts):
            return len(self.text)
        start = self._starts[position.line]
        line = self.text[start : self._line_end(position.line)]
        return start + _characters(line, position.character, self._encoding)

    def position(self, offset: int) -> types.Position:
        """Return the position of the protocol at an offset."""
        line = bisect_right(self._starts, offset) - 1
        before = self.text[self._starts[line] : offset]
        return types.Position(line, _units(before, self._encoding))

    def range(self, span: Span) -> types.Range:
        """Return the range of a span."""
        return self.range_of_offsets(*self.offsets(span))

    def range_of_offsets(self, start: int, end: int) -> types.Range:
        """Return the range between two offsets."""
        return types.Range(self.position(start), self.position(end))

    def offsets(self, span: Span) -> tuple[int, int]:
        """Return the offsets of a span: of its first character, and behind its last."""
        return (
            self.offset_of_place(span.line, span.column),
            self.offset_of_place(span.end_line, span.end_column),
        )

    def line_at(self, offset: int) -> tuple[int, int]:
        """Return the offsets of the line at an offset, without its line break."""
        line = bisect_right(self._starts, offset) - 1
        return self._starts[line], self._line_end(line)

    def _line_end(self, line: int) -> int:
        end = self._starts[line + 1] if line + 1 < len(self._starts) else len(self.text)
        return self._starts[line] + len(self.text[self._starts[line] : end].rstrip("\r\n"))


def _line_starts(line_break: re.Pattern[str], text: str, first: int) -> list[int]:
    return [first, *(first + match.end() for match in line_break.finditer(text))]


def walk(tree: TreeNode, path: Path = ()) -> Iterator[tuple[Path, Span | None, TreeNode]]:
    """Yield every value in document order, with its path and the place of its key, if any."""
    below: Iterable[tuple[str | int, Span | None, TreeNode]] = ()
    if isinstance(tree, MapNode):
        below = ((key, entry.key_span, entry.value) for key, entry in tree.entries.items())
    elif isinstance(tree, ListNode):
        below = ((index, None, item) for index, item in enumerate(tree.items))
    for part, key_span, node in below:
        yield (*path, part), key_span, node
        yield from walk(node, (*path, part))


@dataclass(frozen=True, slots=True)
class DocumentPlace:
    """The innermost key or value at a place.

    Attributes:
        is_key: whether it is the key at `path`, and not its value.
    """

    path: Path
    span: Span
    is_key: bool


def place_at(tree: TreeNode, file: str, place: tuple[int, int]) -> DocumentPlace | None:
    """Return the innermost key or value at a place; None if there is none, as in a comment."""

    def contains(span: Span) -> bool:
        start, end = (span.line, span.column), (span.end_line, span.end_column)
        return span.file == file and start <= place <= end

    innermost: DocumentPlace | None = None
    for path, key_span, node in walk(tree):
        if innermost is not None and path[: len(innermost.path)] != innermost.path:
            continue
        if key_span is not None and contains(key_span):
            return DocumentPlace(path, key_span, is_key=True)
        if contains(node.span):
            innermost = DocumentPlace(path, node.span, is_key=False)
    return innermost


_MARKER: Final = "r2bspec_cursor_marker"
_WORD: Final = re.compile(r"[^\s,:{}\[\]\"'#&*!|>%@`]*")
_WORD_BEFORE: Final = re.compile(r"[^\s,{}\[\]\"'#]*\Z")
_COMMENT: Final = re.compile(r"(?:^|\s)#[^\n]*\Z")
_CLOSING: Final = {"{": "}", "[": "]"}


@dataclass(frozen=True, slots=True)
class CursorContext:
    """What is being written at the cursor.

    Attributes:
        path: the path of the map whose key is written, or of the value.
        is_key: whether a key is written.
        before: what is written of the key or the value before the cursor.
        start: the offset at which the word begins that a completion replaces.
        end: the offset at which it ends.
        siblings: the keys that the map has, without the one that is written.
        has_colon: whether the key is followed by a colon.
        tree: the document, with a marker in place of the word.
    """

    path: Path
    is_key: bool
    before: str
    start: int
    end: int
    siblings: frozenset[str] = frozenset()
    has_colon: bool = False
    tree: TreeNode | None = None


def cursor_context(text: str, offset: int) -> CursorContext | None:
    """Return the context of the cursor at an offset; None in a comment, or if nothing fits."""
    line_start = text.rfind("\n", 0, offset) + 1
    line = text[line_start:offset]
    if _COMMENT.search(line):
        return None
    # 'key:value' is one word in YAML; 'key: value' is split at the space.
    first, rest = _WORD_BEFORE.search(line), _WORD.match(text, offset)
    start = line_start + first.start() if first is not None else offset
    end = rest.end() if rest is not None else offset
    for candidate in _candidates(text, start, end):
        tree = compose(Source("cursor", candidate)).tree
        marked = _marked(tree) if tree is not None else None
        if marked is not None:
            path, is_key, before, siblings = marked
            followed = text[end:].lstrip(" ").startswith(":")
            before += text[start:offset]
            return CursorContext(path, is_key, before, start, end, siblings, followed, tree)
    return None


def _candidates(text: str, start: int, end: int) -> Iterator[str]:
    line_end = text.find("\n", end)
    rest_of_line = text[end : line_end if line_end >= 0 else len(text)]
    above, below = text[:start], text[end:]
    yield f"{above}{_MARKER}{below}"
    if not rest_of_line.lstrip().startswith(":"):
        yield f"{above}{_MARKER}: {below}"
        # In a flow map: a key without a value yet.
        yield f"{above}{_MARKER}: 0{below}"
    closing = _open_brackets(above)
    yield f"{above}{_MARKER}{closing}\n"
    yield f"{above}{_MARKER}: {closing}\n"
    # Of a document that is broken above, too, only the lines that lead here by their indentation.
    leading = "".join(_leading_lines(above))
    yield f"{leading}{_MARKER}{closing}\n"
    yield f"{leading}{_MARKER}: {closing}\n"


def _open_brackets(text: str) -> str:
    """Return what closes the flow collections that are open at the end of a text."""
    opened: list[str] = []
    for line in text.rsplit("\n", 40):
        quote = ""
        for character in line:
            if quote:
                quote = "" if character == quote else quote
            elif character in "\"'":
                quote = character
            elif character == "#":
                break
            elif character in _CLOSING:
                opened.append(_CLOSING[character])
            elif character in "}]" and opened:
                opened.pop()
    return "".join(reversed(opened))


def _leading_lines(above: str) -> list[str]:
    """Return the last line and the lines above that are its parents by indentation."""
    *lines, last = above.split("\n")
    kept = [last]
    indent = len(last) - len(last.lstrip())
    for line in reversed(lines):
        depth = len(line) - len(line.lstrip())
        if line.strip() and depth < indent and not line.lstrip().startswith("#"):
            key, colon, _ = line.partition(":")
            kept.append(f"{key}{colon}\n" if colon else f"{line}\n")
            indent = depth
    return kept[::-1]


def _marked(tree: TreeNode) -> tuple[Path, bool, str, frozenset[str]] | None:
    """Return the path of the marker, whether it is a key, the text before, its sibling keys."""
    nodes: Iterator[tuple[Path, TreeNode]] = ((path, node) for path, _, node in walk(tree))
    for path, node in itertools.chain([((), tree)], nodes):
        if isinstance(node, ScalarNode) and _MARKER in node.text:
            return path, False, node.text.partition(_MARKER)[0], frozenset()
        if isinstance(node, MapNode):
            for key in node.entries:
                if _MARKER in key:
                    return path, True, key.partition(_MARKER)[0], frozenset(node.entries) - {key}
    return None
