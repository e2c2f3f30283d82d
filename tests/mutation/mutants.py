"""Every small mistake that can be made in a spec: its keys and topics, changed one at a time.

A mutant is a text in which one thing differs, and the lines on which it differs. The kinds:

- delete: a key is gone, with its value;
- misspell: a letter of a key is left out;
- duplicate: a key stands twice, with the same value;
- retype: a value is of another type;
- swap: two keys that stand next to each other have changed places, their values have not;
- topic: a letter of a topic is left out, wherever a topic stands.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

from r2bspec.diagnostics import Path, Span, format_path
from r2bspec.language.document import Source
from r2bspec.language.located_tree import Entry, ListNode, MapNode, ScalarNode, TreeNode
from r2bspec.language.yaml_document import compose

KINDS = ("delete", "misspell", "duplicate", "retype", "swap", "topic")

_MAPS_OF_TOPICS = ("topics", "remappings")  # both keys and values are topics
_TOPIC_VALUES = ("topic", "from")


@dataclass(frozen=True, slots=True)
class Mutant:
    """A text with one mistake.

    Attributes:
        kind: one of `KINDS`.
        path: of the key that was changed.
        note: what was done, in a few words.
        lines: the lines of `text` on which the mistake stands; for a deletion, its owner's line.
    """

    kind: str
    path: Path
    note: str
    text: str
    lines: frozenset[int]

    @property
    def label(self) -> str:
        """One line that names the mutant."""
        return f"{self.kind:<9} {format_path(self.path)}: {self.note}"


@dataclass(frozen=True, slots=True)
class _Place:
    """A key with its value, where it stands, and what stands around it."""

    path: Path
    entry: Entry
    owner_line: int
    flow: bool


def mutants(text: str) -> Iterator[Mutant]:
    """Every mutant of a spec that has no mistakes."""
    root = compose(Source("spec", text)).tree
    if not isinstance(root, MapNode):
        raise TypeError("the text is no spec")
    writer = _Writer(text)
    yield from _below(root, (), 1, writer)


def _below(node: TreeNode, path: Path, owner_line: int, writer: _Writer) -> Iterator[Mutant]:
    if isinstance(node, ListNode):
        for index, item in enumerate(node.items):
            yield from _below(item, (*path, index), owner_line, writer)
    if not isinstance(node, MapNode):
        return
    flow = writer.at(node.span).startswith("{")
    places = [_Place((*path, key), entry, owner_line, flow) for key, entry in node.entries.items()]
    for place in places:
        yield writer.deleted(place, places)
        yield from writer.misspelt(place)
        yield writer.duplicated(place)
        yield from writer.retyped(place)
        yield from writer.topics(place)
    for first, second in pairwise(places):
        yield writer.swapped(first, second)
    for place in places:
        line = place.entry.key_span.line
        yield from _below(place.entry.value, place.path, line, writer)


class _Writer:
    """Makes changed copies of one text."""

    def __init__(self, text: str) -> None:
        self._text = text
        self._starts = [0]
        for line in text.split("\n"):
            self._starts.append(self._starts[-1] + len(line) + 1)

    def at(self, span: Span) -> str:
        """The text that a span covers."""
        start, end = self._range(span)
        return self._text[start:end]

    def deleted(self, place: _Place, siblings: list[_Place]) -> Mutant:
        start, end = self._entry(place)
        if not place.flow:
            start, end = self._lines(place)
        elif len(siblings) > 1:
            at = siblings.index(place)
            if at + 1 < len(siblings):
                end = self._range(siblings[at + 1].entry.key_span)[0]
            else:
                start = self._range(siblings[at - 1].entry.value.span)[1]
        text = self._text[:start] + self._text[end:]
        # An empty file cannot be told from a deletion of all, so the owner's line stays.
        return Mutant("delete", place.path, "is gone", text, frozenset({place.owner_line}))

    def misspelt(self, place: _Place) -> Iterator[Mutant]:
        key = str(place.path[-1])
        wrong = _misspelt(key)
        if wrong:
            span = place.entry.key_span
            yield self._replaced("misspell", place.path, f"{key} -> {wrong}", span, wrong)

    def duplicated(self, place: _Place) -> Mutant:
        start, end = self._entry(place)
        if place.flow:
            text = f"{self._text[:end]}, {self._text[start:end]}{self._text[end:]}"
            lines = {place.entry.key_span.line}
        else:
            start, end = self._lines(place)
            block = self._text[start:end]
            block += "" if block.endswith("\n") else "\n"
            text = self._text[:end] + block + self._text[end:]
            line = place.entry.key_span.line
            lines = {line, line + block.count("\n")}
        return Mutant("duplicate", place.path, "stands twice", text, frozenset(lines))

    def retyped(self, place: _Place) -> Iterator[Mutant]:
        node = place.entry.value
        for note, new in _other_types(node):
            if isinstance(node, ScalarNode) or self.at(node.span)[:1] in ("{", "["):
                yield self._replaced("retype", place.path, note, node.span, new)
                continue
            start = self._range(place.entry.key_span)[1]
            end = self._range(node.span)[1]
            text = f"{self._text[:start]}: {new}{self._text[end:]}"
            lines = frozenset({place.entry.key_span.line})
            yield Mutant("retype", place.path, note, text, lines)

    def swapped(self, first: _Place, second: _Place) -> Mutant:
        one, two = (self._range(place.entry.key_span) for place in (first, second))
        text = self._text
        text = (
            text[: one[0]] + text[slice(*two)] + text[one[1] : two[0]] + text[slice(*one)]
            + text[two[1] :]
        )  # fmt: skip
        lines = {place.entry.key_span.line for place in (first, second)}
        return Mutant("swap", first.path, f"with {second.path[-1]}", text, frozenset(lines))

    def topics(self, place: _Place) -> Iterator[Mutant]:
        key, value = str(place.path[-1]), place.entry.value
        around = str(place.path[-2]) if len(place.path) > 1 else ""
        if around in _MAPS_OF_TOPICS or key in _TOPIC_VALUES:
            wrong = _misspelt(value.text) if isinstance(value, ScalarNode) else ""
            if wrong and isinstance(value, ScalarNode):
                note = f"{value.text} -> {wrong}"
                yield self._replaced("topic", place.path, note, value.span, wrong)

    def _replaced(self, kind: str, path: Path, note: str, span: Span, new: str) -> Mutant:
        start, end = self._range(span)
        text = self._text[:start] + new + self._text[end:]
        return Mutant(kind, path, note, text, frozenset({span.line}))

    def _entry(self, place: _Place) -> tuple[int, int]:
        return self._range(place.entry.key_span)[0], self._range(place.entry.value.span)[1]

    def _lines(self, place: _Place) -> tuple[int, int]:
        """The whole lines of an entry in block style."""
        start, end = self._entry(place)
        start = self._text.rfind("\n", 0, start) + 1
        following = self._text.find("\n", max(end - 1, 0))
        return start, following + 1 if following >= 0 else len(self._text)

    def _range(self, span: Span) -> tuple[int, int]:
        start = self._starts[span.line - 1] + span.column - 1
        end = self._starts[span.end_line - 1] + span.end_column - 1
        if span.end_column == 1 and span.end_line > span.line:
            end -= 1  # a block of text ends where the next line begins
        return start, end


def _misspelt(word: str) -> str:
    """The word without its middle letter, or with one more where it is too short for that."""
    if not word or not word.strip("/~").isascii():
        return ""
    if len(word) < 3:
        return f"{word}x"
    for at in (len(word) // 2, len(word) // 2 - 1, len(word) // 2 + 1):
        left = word[:at] + word[at + 1 :]
        if word[at].isalpha() and left != word:
            return left
    return f"{word}x"


def _other_types(node: TreeNode) -> Iterator[tuple[str, str]]:
    if not isinstance(node, ScalarNode):
        yield "the number 7 instead", "7"
        yield "no value", "null"
        return
    shown = json.dumps(node.text, ensure_ascii=False)
    yield "in a list", f"[{shown}]"
    yield "in a map", f"{{x: {shown}}}"
    if isinstance(node.value, str) or node.value is True or node.value is False:
        yield "the number 7 instead", "7"
    if not isinstance(node.value, str):
        yield "as text", shown
    if not isinstance(node.value, bool):
        yield "a truth value instead", "true"
