"""One value of a YAML text changed, added or removed; every other byte is kept.

The new value has the style of what surrounds it: block or flow, the indentation of its neighbours,
their line ends. What the text means with the change is for the caller to check.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Sequence
from typing import Final

from r2bspec.diagnostics import Path, Span
from r2bspec.diagnostics.diagnostic import LINE_BREAK
from r2bspec.language.declaration import language
from r2bspec.language.document import has_errors, read_text
from r2bspec.language.located_tree import (
    Entry,
    ListNode,
    MapNode,
    ScalarNode,
    TreeNode,
    scalars_with_paths,
)
from r2bspec.language.variables import OPENING
from r2bspec.language.yaml_document import compose, to_yaml

_BOM: Final = "\ufeff"
_WIDTH: Final = 100
"""A map or a list that is longer on one line is written in block style."""


def with_value(text: str, path: Path, value: TreeNode | None) -> str | None:
    """The text with another value at a path, or without its key.

    Args:
        text: of a document.
        path: of the value; keys that are missing are added.
        value: None removes the key, or says null where the map has the key from elsewhere.

    Returns:
        None if it cannot be written: an alias, a reference to a variable, or a style that is
        unusual.
    """
    bom = _BOM if text.startswith(_BOM) else ""
    source = read_text(text.removeprefix(bom), "")
    composed = compose(source)
    if composed.tree is None or has_errors(composed.diagnostics):
        return None
    edited = _Text(source.text, composed.tree).with_value(path, value)
    return None if edited is None else bom + edited


class _Text:
    """A YAML text with its own tree: what it extends is not in it, and aliases are seen."""

    def __init__(self, text: str, root: TreeNode) -> None:
        self._text = text
        self._root = root
        self._starts = [0, *(match.end() for match in LINE_BREAK.finditer(text))]
        first_break = LINE_BREAK.search(text)
        self._newline = first_break[0] if first_break is not None else "\n"

    def with_value(self, path: Path, value: TreeNode | None) -> str | None:
        node = self._root
        for depth, part in enumerate(path):
            if not isinstance(node, MapNode):
                return None if value is None else self._replaced(node, _nested(path[depth:], value))
            entry = self._own(node).get(str(part))
            if entry is None:
                # What is inherited is removed by null.
                below = _nested(path[depth + 1 :], value or ScalarNode(None, "null", node.span))
                return self._inserted(node, path[: depth + 1], below)
            if depth == len(path) - 1 and value is None:
                return self._removed(node, entry)
            if _start(entry.value.span) < _start(entry.key_span):
                return None  # An alias.
            node = entry.value
        return None if value is None else self._replaced(node, value)

    def _own(self, node: MapNode) -> dict[str, Entry]:
        """The entries that are written in a map; those that it merges are written before it."""
        return {
            key: entry
            for key, entry in node.entries.items()
            if _start(entry.key_span) >= _start(node.span)
        }

    def _replaced(self, node: TreeNode, value: TreeNode) -> str | None:
        if any(OPENING in scalar.text for _, scalar in scalars_with_paths(node)):
            return None
        start, end = self._place(node)
        if isinstance(node, ScalarNode) and start == end:  # Nothing is written after the colon.
            return self._spliced(start, end, f" {_flow(value)}")
        if self._is_flow(node) or isinstance(node, ScalarNode):
            return self._spliced(start, end, _flow(value))
        # A collection in block style begins below its key, unless it is an item of a list.
        indent = start - self._starts[self._line(start)]
        if isinstance(value, ListNode) and isinstance(node, ListNode) and value.items:
            lines = [f"- {_flow(item)}" for item in value.items]
            return self._spliced(start, end, f"{self._newline}{' ' * indent}".join(lines))
        before = self._text[:start].rstrip()
        if before.endswith(":"):
            return self._spliced(len(before), end, f" {_flow(value)}")
        return self._spliced(start, end, _flow(value))

    def _removed(self, node: MapNode, entry: Entry) -> str | None:
        own = self._own(node)
        if self._is_flow(node) or len(own) == 1:
            rest = {key: other for key, other in own.items() if other is not entry}
            if len(own) < len(node.entries):  # It merges others.
                return None
            return self._replaced(node, MapNode(rest, node.span))
        first, last = entry.key_span.line - 1, self._last_line(entry)
        if self._text[self._starts[first] :][: entry.key_span.column - 1].strip():
            return None
        return self._spliced(self._starts[first], self._after_line(last), "")

    def _inserted(self, node: MapNode, path: Path, value: TreeNode) -> str | None:
        own = self._own(node)
        key = str(path[-1])
        if self._is_flow(node):
            return self._inserted_in_flow(node, own, f"{scalar_text(key)}: {_flow(value)}")
        columns = {entry.key_span.column for entry in own.values()}
        if len(columns) != 1:
            return None
        indent = columns.pop() - 1
        above = self._last_line(own[_sibling_above(path, list(own))])
        lines = [" " * indent + line for line in _block(key, value, self._step(), _WIDTH - indent)]
        at = self._after_line(above)
        if len(path) == 1 and self._separates_sections(own):
            lines.insert(0, "")
        if at == len(self._text) and not LINE_BREAK.search(self._text[-1:]):
            lines.insert(0, "")
            return self._spliced(at, at, self._newline.join(lines))
        return self._spliced(at, at, "".join(line + self._newline for line in lines))

    def _inserted_in_flow(self, node: MapNode, own: dict[str, Entry], pair: str) -> str | None:
        if not own:
            start, end = self._place(node)
            brace = self._text.rfind("{", start, end)
            if self._text[brace + 1 : end].strip("} \t\r\n"):
                return None
            return self._spliced(brace + 1, brace + 1, pair)
        last = own[next(reversed(own))]
        if _start(last.value.span) > _start(last.key_span):
            at = self._place(last.value)[1]
            return self._spliced(at, at, f", {pair}")
        first = self._offset(*_start(next(iter(own.values())).key_span))
        return self._spliced(first, first, f"{pair}, ")

    def _is_flow(self, node: TreeNode) -> bool:
        """Whether a collection is written in brackets or braces."""
        start, end = self._place(node)
        without_anchor = re.sub(r"\A&\S+\s*", "", self._text[start:end])
        return without_anchor.startswith(("{", "[")) and not isinstance(node, ScalarNode)

    def _separates_sections(self, own: dict[str, Entry]) -> bool:
        """Whether there are empty lines between the sections of the document."""
        lines = LINE_BREAK.split(self._text)
        for entry in own.values():
            above = entry.key_span.line - 2
            while above > 0 and lines[above].startswith("#"):
                above -= 1
            if above > 0 and not lines[above].strip():
                return True
        return False

    def _step(self) -> int:
        """By how many columns the file indents a map below its key."""
        pending = [self._root]
        while pending:
            node = pending.pop(0)
            if not isinstance(node, MapNode) or self._is_flow(node):
                continue
            for entry in self._own(node).values():
                below = entry.value
                deeper = below.span.column - entry.key_span.column
                if isinstance(below, MapNode) and not self._is_flow(below) and deeper > 0:
                    return deeper
                pending.append(below)
        return 2

    def _last_line(self, entry: Entry) -> int:
        """The index of the last line of an entry, whose value may be an alias."""
        if _start(entry.value.span) < _start(entry.key_span):
            return entry.key_span.end_line - 1
        return self._line(max(self._place(entry.value)[1] - 1, 0))

    def _place(self, node: TreeNode) -> tuple[int, int]:
        """Where a value begins and ends, without the space that follows one in block style."""
        span = node.span
        start, end = self._offset(*_start(span)), self._offset(span.end_line, span.end_column)
        return start, start + len(self._text[start:end].rstrip())

    def _offset(self, line: int, column: int) -> int:
        # A value at the end of the file ends on a line that is not there.
        starts = self._starts
        return starts[line - 1] + column - 1 if line <= len(starts) else len(self._text)

    def _line(self, offset: int) -> int:
        return sum(start <= offset for start in self._starts) - 1

    def _after_line(self, line: int) -> int:
        return self._starts[line + 1] if line + 1 < len(self._starts) else len(self._text)

    def _spliced(self, start: int, end: int, text: str) -> str:
        return self._text[:start] + text + self._text[end:]


def _start(span: Span) -> tuple[int, int]:
    return span.line, span.column


def _nested(path: Path, value: TreeNode) -> TreeNode:
    """The value below the maps of a path."""
    for part in reversed(path):
        value = MapNode({str(part): Entry(value.span, value)}, value.span)
    return value


def _sibling_above(path: Path, keys: Sequence[str]) -> str:
    """The key after which a new one belongs: a section in the order of the language, else last."""
    if len(path) == 1:
        order = list(language().keys or ())
        earlier = order[: order.index(str(path[0]))] if path[0] in order else []
        above = [key for key in keys if key in earlier]
        if above:
            return above[-1]
    return keys[-1]


def _block(key: str, value: TreeNode, step: int, width: int) -> Iterator[str]:
    """The lines of an entry in block style; what is short has braces or brackets."""
    line = f"{scalar_text(key)}: {_flow(value)}"
    if isinstance(value, MapNode) and value.entries:
        is_deep = any(isinstance(entry.value, MapNode) for entry in value.entries.values())
        if is_deep or len(line) > width:
            yield f"{scalar_text(key)}:"
            for name, entry in value.entries.items():
                lines = _block(name, entry.value, step, width - step)
                yield from (" " * step + below for below in lines)
            return
    if isinstance(value, ListNode) and len(line) > width:
        yield f"{scalar_text(key)}:"
        yield from (f"{' ' * step}- {_flow(item)}" for item in value.items)
        return
    yield line


def _flow(node: TreeNode) -> str:
    """A value on one line."""
    if isinstance(node, MapNode):
        entries = (
            f"{scalar_text(key)}: {_flow(entry.value)}" for key, entry in node.entries.items()
        )
        return "{" + ", ".join(entries) + "}"
    if isinstance(node, ListNode):
        return "[" + ", ".join(map(_flow, node.items)) + "]"
    if isinstance(node, ScalarNode) and not isinstance(node.value, str):
        return node.text or "null"
    return scalar_text(node.text) if isinstance(node, ScalarNode) else "null"


_PLAIN: Final = re.compile(r"[A-Za-z0-9_/.][A-Za-z0-9_/.+%-]*(?: [A-Za-z0-9_/.+%-]+)*")
_NOT_WRITTEN: Final = re.compile("[\x7f-\x9f\u2028\u2029\ufeff]")


def scalar_text(text: str) -> str:
    """A text, quoted where YAML 1.1 or 1.2 would not read it as one."""
    if _PLAIN.fullmatch(text) and to_yaml(text).partition("\n")[0] == text:
        return text
    quoted = json.dumps(text, ensure_ascii=False)
    return _NOT_WRITTEN.sub(lambda found: f"\\u{ord(found[0]):04x}", quoted)
