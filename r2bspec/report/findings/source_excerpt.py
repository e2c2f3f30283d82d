"""A source line with carets under a span, truncated to the width of a terminal."""

from __future__ import annotations

import unicodedata
from functools import lru_cache

from r2bspec.diagnostics.diagnostic import Span, split_lines
from r2bspec.diagnostics.quote import printable

MAX_WIDTH = 100
"""The most characters of a source line that are shown."""

_CONTEXT_BEFORE = 40  # characters kept before the span in a truncated line


def excerpt(span: Span, text: str) -> tuple[str, str] | None:
    """The line of a span and the carets under it; None if the text has no such line.

    A span of several lines is marked to the end of its first line.
    """
    lines = _lines(text)
    if not 0 < span.line <= len(lines):
        return None
    line = lines[span.line - 1].rstrip()
    if not line:
        return None
    start = min(span.column - 1, len(line))
    end = span.end_column - 1 if span.end_line == span.line else len(line)
    end = max(min(end, len(line)), start + 1)
    line, start, end = _window(line, start, end)
    shown = printable(line.replace("\t", " "))
    return shown, " " * _width(shown[:start]) + "^" * max(_width(shown[start:end]), 1)


def _window(line: str, start: int, end: int) -> tuple[str, int, int]:
    if len(line) <= MAX_WIDTH:
        return line, start, end
    first = min(max(start - _CONTEXT_BEFORE, 0), len(line) - MAX_WIDTH)
    cut = line[first : first + MAX_WIDTH]
    if first + MAX_WIDTH < len(line):
        cut = cut[:-1] + "…"
    if first:
        cut = "…" + cut[1:]
    return cut, start - first, min(end - first, MAX_WIDTH)


def _width(text: str) -> int:
    """The columns that the text takes on a terminal."""
    if text.isascii():
        return len(text)
    wide = sum(unicodedata.east_asian_width(char) in "WF" for char in text)
    return len(text) + wide - sum(unicodedata.combining(char) > 0 for char in text)


@lru_cache(maxsize=8)
def _lines(text: str) -> list[str]:
    return split_lines(text)
