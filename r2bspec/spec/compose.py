"""YAML text into a located tree, by a loop over the parser's events.

PyYAML's own composer recurses once per level and expands aliases without limit, and its
constructor drops positions; this one does neither. No object is ever constructed from a tag. Its
limits are stated here, each with a diagnostic:

- `DEEPEST` levels of nesting,
- `MOST_VALUES` keys and values in the document,
- `MOST_SHARED` keys and values more, once every alias is written out.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

import yaml
from yaml import events as ev

from r2bspec.diagnostics import Diagnostic, Edit, Related, Severity, Span
from r2bspec.diagnostics.quote import quote
from r2bspec.spec.merge import Merge, merged
from r2bspec.spec.scalars import ScalarError, ScalarValue, resolve
from r2bspec.spec.source import Source
from r2bspec.spec.syntax import explain_syntax_error
from r2bspec.spec.tree import Entry, ListNode, MapNode, ScalarNode, TreeNode, UnknownNode

DEEPEST = 100
MOST_VALUES = 400_000
MOST_SHARED = 200_000

_Loader: Any = getattr(yaml, "CLoader", yaml.Loader)


@dataclass(frozen=True, slots=True)
class Composed:
    """The tree, or None where the text is no document; and what was wrong with it."""

    tree: TreeNode | None
    diagnostics: tuple[Diagnostic, ...]


@dataclass(slots=True)
class _Open:
    """A collection whose end has not come yet."""

    start: Span
    anchor: str | None
    is_map: bool
    size: int = 1
    items: list[TreeNode] = field(default_factory=list)
    entries: dict[str, Entry] = field(default_factory=dict)
    merges: list[Merge] = field(default_factory=list)
    key: TreeNode | None = None


class _StopError(Exception):
    """The rest of the document is not worth reading; why has been reported."""


def compose(source: Source) -> Composed:
    """Compose the one document of `source`. Never raises for any text."""
    composer = _Composer(source)
    try:
        composer.run(yaml.parse(source.text, Loader=_Loader))
    except _StopError:
        return Composed(None, tuple(composer.diagnostics))
    except yaml.YAMLError as error:
        composer.diagnostics.append(explain_syntax_error(error, source))
        return Composed(None, tuple(composer.diagnostics))
    return Composed(composer.root, tuple(composer.diagnostics))


class _Composer:
    def __init__(self, source: Source) -> None:
        self.source = source
        self.diagnostics: list[Diagnostic] = []
        self.root: TreeNode | None = None
        self._open: list[_Open] = []
        self._anchors: dict[str, tuple[TreeNode, int]] = {}
        self._values = 0
        self._shared = 0
        self._documents = 0

    def run(self, parsed: Iterator[ev.Event]) -> None:
        for event in parsed:
            kind = type(event)
            if kind is ev.ScalarEvent:
                self._count(event)
                self._add(self._scalar(event), 1, event.anchor)
            elif kind is ev.MappingStartEvent or kind is ev.SequenceStartEvent:
                self._begin(event, is_map=kind is ev.MappingStartEvent)
            elif kind is ev.MappingEndEvent or kind is ev.SequenceEndEvent:
                self._end(event)
            elif kind is ev.AliasEvent:
                self._alias(event)
            elif kind is ev.DocumentStartEvent:
                self._document(event)
        if self._documents == 0:
            self._stop(
                "R2B020",
                "the file holds no YAML document",
                Span.of_file(self.source.file),
                "a spec begins with 'r2bspec: 1' and 'name: ...'",
            )

    def _document(self, event: Any) -> None:
        self._documents += 1
        if self._documents > 1:
            self._stop(
                "R2B021",
                "a second document begins here; a file holds one benchmark",
                self._span(event),
                "put it into a file of its own, or remove the '---'",
            )

    def _count(self, event: Any) -> None:
        self._values += 1
        if self._values > MOST_VALUES:
            self._stop(
                "R2B002",
                f"the document has more than {MOST_VALUES:,} keys and values",
                self._span(event),
                "is this the right file?",
            )

    def _scalar(self, event: Any) -> TreeNode:
        span = self._span(event)
        if event.tag is not None:
            self._refuse_tag(event, span)
            return UnknownNode(span)
        text: str = event.value
        style: str = event.style or ""
        if style:
            return ScalarNode(text, text, span, style)
        value: ScalarValue
        try:
            value = resolve(text)
        except ScalarError as error:
            self._error(
                "R2B029", f"{quote(text)} is {error}", span, "quote it if it is meant as text"
            )
            return UnknownNode(span)
        return ScalarNode(value, text, span)

    def _begin(self, event: Any, *, is_map: bool) -> None:
        self._count(event)
        span = self._span(event)
        if event.tag is not None:
            self._refuse_tag(event, span)
        if len(self._open) >= DEEPEST:
            self._stop(
                "R2B025",
                f"values are nested more than {DEEPEST} levels deep",
                span,
                "is a bracket or a brace left open?",
            )
        self._open.append(_Open(span, event.anchor, is_map))

    def _end(self, event: Any) -> None:
        done = self._open.pop()
        node: TreeNode
        if done.is_map:
            entries = done.entries
            if done.merges:
                entries = merged(done.merges, entries)
            last = next(reversed(entries.values())).value if entries else None
            node = MapNode(entries, self._extent(done, event, last))
        else:
            last = done.items[-1] if done.items else None
            node = ListNode(tuple(done.items), self._extent(done, event, last))
        self._add(node, done.size, done.anchor)

    def _extent(self, done: _Open, event: Any, last: TreeNode | None) -> Span:
        """From the first to the last character; a block collection has no closing mark."""
        end, start = event.end_mark, done.start
        if last is not None and event.start_mark.index == end.index:
            tail = last.span
            if (tail.end_line, tail.end_column) >= (start.line, start.column):
                return Span(start.file, start.line, start.column, tail.end_line, tail.end_column)
        return Span(start.file, start.line, start.column, end.line + 1, end.column + 1)

    def _alias(self, event: Any) -> None:
        name, span = event.anchor, self._span(event)
        if any(frame.anchor == name for frame in self._open):
            self._error(
                "R2B026",
                f"'*{name}' stands inside the value that '&{name}' names: it would never end",
                span,
                "name a smaller part, or repeat what is meant",
            )
            self._add(UnknownNode(span), 1, None)
            return
        if name not in self._anchors:
            self._error(
                "R2B026",
                f"'*{name}' refers to '&{name}', which does not come before it",
                span,
                f"mark the value that is meant with '&{name}', or quote the text if it begins "
                "with a star",
            )
            self._add(UnknownNode(span), 1, None)
            return
        node, size = self._anchors[name]
        self._shared += size
        if self._shared > MOST_SHARED:
            self._stop(
                "R2B027",
                f"written out, the aliases of this document stand for more than "
                f"{MOST_SHARED:,} values",
                span,
                "refer to smaller parts",
            )
        self._add(node, size, None, used_at=span)

    def _add(
        self, node: TreeNode, size: int, anchor: str | None, *, used_at: Span | None = None
    ) -> None:
        if anchor is not None:
            self._anchors[anchor] = (node, size)
        if not self._open:
            self.root = node
            return
        frame = self._open[-1]
        frame.size += size
        if not frame.is_map:
            frame.items.append(node)
        elif frame.key is None:
            frame.key = node
        else:
            key, frame.key = frame.key, None
            self._pair(frame, key, node, used_at or node.span)

    def _pair(self, frame: _Open, key: TreeNode, value: TreeNode, value_span: Span) -> None:
        if not isinstance(key, ScalarNode):
            if not isinstance(key, UnknownNode):
                self._error("R2B024", "a key must be a word, not a list or a map", key.span)
            return
        if key.text == "<<" and not key.style:
            self._merge(frame, key, value, value_span)
            return
        name = key.value
        if not isinstance(name, str):
            self._odd_key(key)
            name = key.text
        earlier = frame.entries.get(name)
        if earlier is not None:
            self._error(
                "R2B023",
                f"the key {quote(name)} stands here for the second time",
                key.span,
                "remove or rename one of the two",
                related=(Related("the first one", earlier.key_span),),
            )
            return
        frame.entries[name] = Entry(key.span, value)

    def _merge(self, frame: _Open, key: ScalarNode, value: TreeNode, span: Span) -> None:
        sources = value.items if isinstance(value, ListNode) else (value,)
        if frame.merges:
            self._error(
                "R2B028",
                "'<<' stands here for the second time",
                key.span,
                "merge several with one list: '<<: [*a, *b]'",
            )
            return
        for part in sources:
            if isinstance(part, MapNode):
                frame.merges.append(Merge(key.span, part))
            elif not isinstance(part, UnknownNode):
                self._error(
                    "R2B028",
                    "'<<' merges maps, and this is none",
                    span,
                    "write '<<: *name', where '&name' marks a map",
                )

    def _odd_key(self, key: ScalarNode) -> None:
        what = {bool: "a truth value", int: "a number", float: "a number"}.get(
            type(key.value), "no value"
        )
        text = f'"{key.text}"'
        self._error(
            "R2B024",
            f"a key must be text; {quote(key.text)} is {what}",
            key.span,
            f"quote it: {text}" if key.text else "write a key before the ':'",
            edit=Edit(key.span, text) if key.text else None,
        )

    def _refuse_tag(self, event: Any, span: Span) -> None:
        written = self.source.line(span.line)[span.column - 1 :].split()
        self._error(
            "R2B022",
            f"tags such as {quote(written[0] if written else event.tag)} are not part of the "
            "language",
            span,
            "remove it; every value has the type that its text shows",
        )

    def _span(self, event: Any) -> Span:
        start, end = event.start_mark, event.end_mark
        return Span(
            self.source.file, start.line + 1, start.column + 1, end.line + 1, end.column + 1
        )

    def _error(
        self,
        code: str,
        message: str,
        span: Span,
        help_text: str = "",
        *,
        related: tuple[Related, ...] = (),
        edit: Edit | None = None,
    ) -> None:
        self.diagnostics.append(
            Diagnostic(
                code, Severity.ERROR, message, span, help=help_text, related=related, edit=edit
            )
        )

    def _stop(self, code: str, message: str, span: Span, help_text: str) -> None:
        self._error(code, message, span, help_text)
        raise _StopError
