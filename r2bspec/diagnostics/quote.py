"""Quoting values of a document in messages: short, on one line, without control characters."""

from __future__ import annotations

MAX_SHOWN_CHARS = 60
"""The most characters of a value that a message shows."""


def printable(text: str) -> str:
    """The text with every control character replaced by U+FFFD."""
    if text.isprintable():
        return text
    return "".join(char if char.isprintable() else "\ufffd" for char in text)


def printable_lines(text: str) -> str:
    """The same, but line breaks stay: for formats that have several lines in a value."""
    return "\n".join(map(printable, text.splitlines()))


def clip(text: str, max_length: int = MAX_SHOWN_CHARS) -> str:
    """The text on one line, truncated to `max_length` characters."""
    short = text[: max_length + 1]
    line = printable(short.replace("\n", "⏎").replace("\t", " "))
    return line if len(line) <= max_length else line[: max_length - 1] + "…"


def quote(text: str) -> str:
    """The text in single quotes, truncated."""
    return f"'{clip(text)}'"
