"""An editor as a new user has it: keys, proposals, and the stops of snippets; nothing is pasted.

It keeps what was typed, so that a test can say what completion could not offer.
"""

from __future__ import annotations

import re
from collections.abc import Awaitable, Callable
from dataclasses import dataclass, field

from lsprotocol import types

_PUNCTUATION = re.compile(r"[\s:\[\],{}\-]+")
_STOP = re.compile(
    r"\\(?P<plain>[\\$}])|\$(?:\{(?P<number>\d+)(?::(?P<kept>[^}]*))?\}|(?P<bare>\d+))"
)


Complete = Callable[[str, int], Awaitable[list[types.CompletionItem]]]
"""The items that a server offers for a text with the cursor at an offset."""


@dataclass
class TypingEditor:
    """A text with a cursor, and the stops of the snippet that was accepted last.

    Attributes:
        typed: the words that were typed; spaces, line breaks and punctuation do not count.
    """

    complete: Complete
    text: str = ""
    cursor: int = 0
    typed: list[str] = field(default_factory=list)
    _stops: list[tuple[int, int]] = field(default_factory=list)
    _place: tuple[int, int] = (0, 0)

    def type(self, text: str) -> None:
        """Type what there is no proposal for; over the text of a stop that is selected."""
        self.typed += [each for each in _PUNCTUATION.split(text) if each]
        start, end = self._place
        selected = start == self.cursor and end > start
        self._replace(self.cursor, end if selected else self.cursor, text)

    def line(self, text: str) -> None:
        """Begin a line; the snippet has ended."""
        self._stops = []
        self._place = (self.cursor, self.cursor)
        self.type(text)

    async def accept(self, label: str) -> None:
        """Accept a proposal, as VS Code does: with its indentation, over the range that it says."""
        # The text of a stop that is selected counts as the beginning of what is wanted.
        self.cursor = max(self.cursor, self._place[1])
        items = {each.label: each for each in await self.complete(self.text, self.cursor)}
        if label not in items:
            shown = "\n".join(sorted(items))
            raise AssertionError(f"{label!r} is not offered after {self._before()!r}:\n{shown}")
        item = items[label]
        edit = item.text_edit
        assert isinstance(edit, types.TextEdit)
        first, last = self._offset(edit.range.start), self._offset(edit.range.end)
        written = self.text[first : self.cursor]
        assert (item.filter_text or label).casefold().startswith(written.casefold()), (
            f"an editor does not show {label!r} for {written!r}"
        )
        new_text = edit.new_text
        if item.insert_text_mode is not types.InsertTextMode.AsIs:
            new_text = new_text.replace("\n", f"\n{self._indent()}")
        if item.insert_text_format is types.InsertTextFormat.Snippet:
            self._replace(first, last, "")
            self._insert_snippet(new_text)
        else:
            self._replace(first, last, new_text)

    def next_stop(self) -> None:
        """Press Tab: go to the next stop, whose text is selected."""
        self._place = self._stops.pop(0)
        self.cursor = self._place[0]

    def _insert_snippet(self, body: str) -> None:
        parts: list[str] = []
        stops: dict[int, list[tuple[int, int]]] = {}
        length = 0
        end_of_last = 0
        for match in _STOP.finditer(body):
            before = body[end_of_last : match.start()]
            kept = match["plain"] or match["kept"] or ""
            parts += [before, kept]
            length += len(before) + len(kept)
            if not match["plain"]:
                number = int(match["number"] or match["bare"])
                stops.setdefault(number, []).append((length - len(kept), length))
            end_of_last = match.end()
        parts.append(body[end_of_last:])
        inserted_at = self.cursor
        self._replace(inserted_at, inserted_at, "".join(parts))
        ordered = sorted(stops, key=lambda number: (number == 0, number))
        self._stops = [
            (inserted_at + stops[each][0][0], inserted_at + stops[each][0][1]) for each in ordered
        ]
        if self._stops:
            self.next_stop()

    def _replace(self, start: int, end: int, text: str) -> None:
        self.text = self.text[:start] + text + self.text[end:]
        moved = len(text) - (end - start)
        self._stops = [
            (first + moved, last + moved) if first >= end else (first, last)
            for first, last in self._stops
        ]
        self.cursor = start + len(text)
        self._place = (self.cursor, self.cursor)

    def _before(self) -> str:
        return self.text[: self.cursor].rpartition("\n")[2]

    def _indent(self) -> str:
        line = self._before()
        return line[: len(line) - len(line.lstrip())]

    def _offset(self, position: types.Position) -> int:
        lines = self.text.split("\n")
        return sum(len(line) + 1 for line in lines[: position.line]) + position.character
