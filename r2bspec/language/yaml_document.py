"""Composing a located tree from YAML text, by a loop over the parser's events.

PyYAML's own composer recurses once per level and expands aliases without limit, and its
constructor drops positions; this one does neither. No object is ever constructed from a tag. A list
or a map is a `CollectionBuilder` until its end is read; ``<<`` merges maps with an anchor. Each
limit has a diagnostic of its own:

- `MAX_YAML_DEPTH` levels of nesting,
- `MAX_YAML_VALUES` keys and values in the document,
- `MAX_YAML_EXPANDED_VALUES` additional keys and values after all aliases are expanded.

Unquoted scalars have the values of the core schema of YAML 1.2. YAML 1.1, which PyYAML implements,
turns ``on`` and ``no`` into booleans, ``12:30`` into 750 and ``010`` into 8. Here they are strings,
and so are dates. There is one deliberate deviation from the core schema: ``010`` is neither 8 nor
10 but text, because readers disagree about it. What `to_yaml` writes, `resolve` reads back
unchanged.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from itertools import chain
from typing import Any

import msgspec
import yaml
from yaml import events as ev

from r2bspec.diagnostics import Diagnostic, Edit, Related, Span
from r2bspec.diagnostics.quote import quote
from r2bspec.language.document import DiagnosticCollector, Source, StopReadingError, has_errors
from r2bspec.language.located_tree import (
    Entry,
    ListNode,
    MapNode,
    ScalarNode,
    ScalarValue,
    TreeNode,
    UnknownNode,
)
from r2bspec.language.yaml_syntax_errors import TOO_DEEP, TOO_DEEP_HELP, explain_syntax_error
from r2bspec.safe_io import limits

_CONSTANTS: dict[str, ScalarValue] = {
    "": None,
    "~": None,
    **dict.fromkeys(("null", "Null", "NULL"), None),
    **dict.fromkeys(("true", "True", "TRUE"), True),
    **dict.fromkeys(("false", "False", "FALSE"), False),
}
_MAYBE_NUMBER = frozenset("+-.0123456789")
_DECIMAL = re.compile(r"[-+]?(?:0|[1-9][0-9]*)")
_PREFIXED_INT = re.compile(r"0o[0-7]+|0x[0-9a-fA-F]+")
_FLOAT = re.compile(r"[-+]?(?:\.[0-9]+|(?:0|[1-9][0-9]*)(?:\.[0-9]*)?)(?:[eE][-+]?[0-9]+)?")
_NOT_FINITE = re.compile(r"[-+]?\.(?:inf|Inf|INF)|\.(?:nan|NaN|NAN)")

_MAX_INT = 2**63 - 1


class ScalarError(ValueError):
    """A number that is not supported in specs."""


def resolve(text: str) -> ScalarValue:
    """Return the value of an unquoted scalar.

    Raises:
        ScalarError: an integer that exceeds 64 bits, or a number that is not finite.
    """
    if text[:1] not in _MAYBE_NUMBER:
        return _CONSTANTS.get(text, text)
    if _DECIMAL.fullmatch(text):
        return _integer(text, 10)
    if _PREFIXED_INT.fullmatch(text):
        return _integer(text, 0)
    if _FLOAT.fullmatch(text):
        return _finite(float(text))
    if _NOT_FINITE.fullmatch(text):
        return _finite(math.inf)
    return text


def parse_unquoted(text: str) -> ScalarValue:
    """Return the value of a text from outside, read like an unquoted value of the document."""
    if not text:
        return text
    try:
        return resolve(text)
    except ScalarError:
        return text


def _integer(text: str, base: int) -> int:
    # The length is checked first: Python needs quadratic time for long digit strings.
    if len(text) <= limits.MAX_INTEGER_CHARACTERS:
        value = int(text, base)
        if -_MAX_INT - 1 <= value <= _MAX_INT:
            return value
    raise ScalarError("an integer that exceeds 64 bits")


def _finite(value: float) -> float:
    # Plans and results are JSON, which cannot represent these.
    if math.isfinite(value):
        return value
    raise ScalarError("not a finite number")


class _Dumper(getattr(yaml, "CSafeDumper", yaml.SafeDumper)):  # type: ignore[misc]
    """Writes shared values in full, and quotes what YAML 1.1 or YAML 1.2 would not read as text."""

    def ignore_aliases(self, data: object) -> bool:
        del data
        return True


def _represent_text(dumper: _Dumper, data: str) -> yaml.ScalarNode:
    try:
        style = None if isinstance(resolve(data), str) else "'"
    except ScalarError:
        style = "'"
    written: yaml.ScalarNode = dumper.represent_scalar("tag:yaml.org,2002:str", data, style=style)
    return written


_Dumper.add_representer(str, _represent_text)


def to_yaml(plain: Any) -> str:
    """Return the YAML text of dicts, lists and scalars; keys keep their order."""
    written: str = yaml.dump(plain, Dumper=_Dumper, sort_keys=False, allow_unicode=True, width=100)
    return written


_TYPE_NAMES = {bool: "a boolean", int: "a number", float: "a number"}


class CollectionBuilder(msgspec.Struct):
    """A list or a map whose end has not been read yet.

    Attributes:
        size: keys and values in it so far, with aliases expanded.
        key: in a map, the key whose value comes next.
    """

    start: Span
    anchor: str | None
    is_map: bool
    problems: DiagnosticCollector
    size: int = 1
    items: list[TreeNode] = msgspec.field(default_factory=list)
    entries: dict[str, Entry] = msgspec.field(default_factory=dict)
    merges: list[MapNode] = msgspec.field(default_factory=list)
    key: TreeNode | None = None

    def add(self, node: TreeNode, size: int, span: Span) -> None:
        """Add the next node: an item, a key or a value.

        Args:
            node: the next node.
            size: keys and values in it.
            span: its place; for an alias, the place of the alias.
        """
        self.size += size
        if not self.is_map:
            self.items.append(node)
        elif self.key is None:
            self.key = node
        else:
            key, self.key = self.key, None
            self._add_entry(key, node, span)

    def last(self) -> TreeNode | None:
        """Return the last value."""
        if not self.is_map:
            return self.items[-1] if self.items else None
        return next(reversed(self.entries.values())).value if self.entries else None

    def node(self, span: Span) -> TreeNode:
        """Return the finished collection."""
        if not self.is_map:
            return ListNode(tuple(self.items), span)
        if not self.merges:
            return MapNode(self.entries, span)
        # What is merged comes first, and keeps its place; what is written first has precedence.
        merged: dict[str, Entry] = {}
        for key, entry in chain.from_iterable(source.entries.items() for source in self.merges):
            merged.setdefault(key, entry)
        return MapNode(merged | self.entries, span)

    def _add_entry(self, key: TreeNode, value: TreeNode, span: Span) -> None:
        if not isinstance(key, ScalarNode):
            if not isinstance(key, UnknownNode):
                message = "a key must be a string, not a list or a map"
                self.problems.error("R2B024", message, key.span)
            return
        if key.text == "<<" and not key.style:
            self._add_merge(key, value, span)
            return
        name = key.value
        if not isinstance(name, str):
            self._reject_key(key)
            self.entries.setdefault(key.text, Entry(key.span, value, key_resolved=False))
            return
        earlier = self.entries.get(name)
        if earlier is not None:
            self.problems.error(
                "R2B023",
                f"duplicate key {quote(name)}",
                key.span,
                "remove or rename one of them",
                related=(Related("first used here", earlier.key_span),),
            )
            return
        self.entries[name] = Entry(key.span, value)

    def _add_merge(self, key: ScalarNode, value: TreeNode, span: Span) -> None:
        if self.merges:
            self.problems.error(
                "R2B028",
                "duplicate merge key '<<'",
                key.span,
                "merge several maps with a list: '<<: [*a, *b]'",
            )
            return
        for part in value.items if isinstance(value, ListNode) else (value,):
            if isinstance(part, MapNode):
                self.merges.append(part)
            elif not isinstance(part, UnknownNode):
                self.problems.error(
                    "R2B028",
                    "'<<' can merge only maps",
                    span,
                    "write '<<: *name', where '&name' is the anchor of a map",
                )

    def _reject_key(self, key: ScalarNode) -> None:
        what = _TYPE_NAMES.get(type(key.value), "null")
        text = f'"{key.text}"'
        self.problems.error(
            "R2B024",
            f"a key must be a string; {quote(key.text)} is {what}",
            key.span,
            f"quote it: {text}" if key.text else "write a key before the ':'",
            edit=Edit(key.span, text) if key.text else None,
        )


class ComposeResult(msgspec.Struct, frozen=True):
    """The tree, or None if the text is no document, and its problems with those of the source."""

    tree: TreeNode | None
    diagnostics: tuple[Diagnostic, ...]


def compose(source: Source) -> ComposeResult:
    """Compose the document in `source`. Never raises because of the text."""
    if has_errors(source.diagnostics):
        return ComposeResult(None, source.diagnostics)
    composer = _Composer(source)
    diagnostics = composer.problems.diagnostics
    diagnostics += source.diagnostics
    try:
        # The events of libyaml without the detour that `yaml.parse` takes; they end with None.
        parser: Any = yaml.CBaseLoader(source.text)
        composer.run(iter(parser.get_event, None))
    except StopReadingError:
        return ComposeResult(None, tuple(diagnostics))
    except yaml.YAMLError as error:
        diagnostics.append(explain_syntax_error(error, source))
        return ComposeResult(None, tuple(diagnostics))
    return ComposeResult(composer.root, tuple(diagnostics))


class _Composer:
    def __init__(self, source: Source) -> None:
        self.problems = DiagnosticCollector()
        self.root: TreeNode | None = None
        self._source = source
        self._open: list[CollectionBuilder] = []
        self._anchors: dict[str, tuple[TreeNode, int]] = {}
        self._values = 0
        self._shared = 0
        self._documents = 0

    def run(self, parsed: Iterator[Any]) -> None:
        # The loop over all events: what most of them need is written out in it.
        scalar, add, file = self._scalar, self._add, self._source.file
        for event in parsed:
            kind = type(event)
            if kind is ev.ScalarEvent:
                start, end = event.start_mark, event.end_mark
                span = Span(file, start.line + 1, start.column + 1, end.line + 1, end.column + 1)
                self._count_value(span)
                add(scalar(event, span), 1, event.anchor, span)
            elif kind is ev.MappingEndEvent or kind is ev.SequenceEndEvent:
                done = self._open.pop()
                span = _collection_span(done, event)
                add(done.node(span), done.size, done.anchor, span)
            elif kind is ev.MappingStartEvent or kind is ev.SequenceStartEvent:
                self._start_collection(event, is_map=kind is ev.MappingStartEvent)
            elif kind is ev.AliasEvent:
                self._alias(event)
            elif kind is ev.DocumentStartEvent:
                self._documents += 1
                if self._documents > 1:
                    self.problems.stop(
                        "R2B021",
                        "a second YAML document starts here; a file contains one benchmark",
                        self._span(event),
                        "move it to its own file, or remove the '---'",
                    )
        if self._documents == 0:
            self.problems.stop(
                "R2B020",
                "the file contains no YAML document",
                Span.of_file(self._source.file),
                "a spec begins with 'r2bspec: 1' and 'name: ...'",
            )

    def _count_value(self, span: Span) -> None:
        self._values += 1
        if self._values > limits.MAX_YAML_VALUES:
            message = f"the document has more than {limits.MAX_YAML_VALUES:,} keys and values"
            self.problems.stop("R2B002", message, span, "check the path: a spec has a few hundred")

    def _scalar(self, event: Any, span: Span) -> TreeNode:
        if event.tag is not None:
            self._reject_tag(event, span)
            return UnknownNode(span)
        text: str = event.value
        style: str = event.style or ""
        if style:
            return ScalarNode(text, text, span, style)
        try:
            return ScalarNode(resolve(text), text, span)
        except ScalarError as error:
            message = f"{quote(text)} is {error}"
            self.problems.error("R2B029", message, span, "quote it if it is text")
            return UnknownNode(span)

    def _start_collection(self, event: Any, *, is_map: bool) -> None:
        span = self._span(event)
        self._count_value(span)
        if event.tag is not None:
            self._reject_tag(event, span)
        if len(self._open) >= limits.MAX_YAML_DEPTH:
            self.problems.stop("R2B025", TOO_DEEP, span, TOO_DEEP_HELP)
        self._open.append(CollectionBuilder(span, event.anchor, is_map, self.problems))

    def _alias(self, event: Any) -> None:
        name, span = event.anchor, self._span(event)
        contains_it = any(frame.anchor == name for frame in self._open)
        if contains_it or name not in self._anchors:
            message = f"alias '*{name}' has no anchor '&{name}' before it"
            help_text = f"add '&{name}' to an earlier value, or quote the text if it is no alias"
            if contains_it:
                message = f"alias '*{name}' refers to a value that contains it"
                help_text = "put the anchor on a smaller value, or write the value out"
            self.problems.error("R2B026", message, span, help_text)
            self._add(UnknownNode(span), 1, None, span)
            return
        node, size = self._anchors[name]
        self._shared += size
        most = limits.MAX_YAML_EXPANDED_VALUES
        if self._shared > most:
            message = f"the aliases of this document expand to more than {most:,} values"
            self.problems.stop("R2B027", message, span, "use aliases for smaller values")
        self._add(node, size, None, span)

    def _add(self, node: TreeNode, size: int, anchor: str | None, used_at: Span) -> None:
        if anchor is not None:
            self._anchors[anchor] = (node, size)
        if self._open:
            self._open[-1].add(node, size, used_at)
        else:
            self.root = node

    def _reject_tag(self, event: Any, span: Span) -> None:
        written = self._source.line(span.line)[span.column - 1 :].split()
        self.problems.error(
            "R2B022",
            f"YAML tags such as {quote(written[0] if written else event.tag)} are not supported",
            span,
            "remove the tag; the type of a value follows from its text",
        )

    def _span(self, event: Any) -> Span:
        start, end = event.start_mark, event.end_mark
        return Span(
            self._source.file, start.line + 1, start.column + 1, end.line + 1, end.column + 1
        )


def _collection_span(done: CollectionBuilder, event: Any) -> Span:
    """From the first to the last character of a collection.

    One in block style has no closing mark: it ends with its last value, unless that is an alias,
    whose value is written elsewhere.
    """
    start, end = done.start, event.end_mark
    last = done.last()
    if last is not None and event.start_mark.index == end.index:
        tail = (last.span.end_line, last.span.end_column)
        if tail >= (start.line, start.column):
            return Span(start.file, start.line, start.column, *tail)
    return Span(start.file, start.line, start.column, end.line + 1, end.column + 1)
