"""Python expressions as text, laid out as people write them: literals, calls, comments."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, Final

import msgspec

WIDTH: Final = 99


class Code(msgspec.Struct, frozen=True):
    """An expression that is written as it is."""

    text: str


class Call(msgspec.Struct, frozen=True):
    """A call of a class of the launch packages; arguments that are None are left out."""

    name: str
    arguments: tuple[Any, ...] = ()
    keywords: Mapping[str, Any] = {}
    comments: tuple[str, ...] = ()


def commented(call: Call, comments: Sequence[str]) -> Call:
    """A call with further comments above it."""
    return msgspec.structs.replace(call, comments=(*call.comments, *comments))


def render(value: object, indent: int, around: int = 0) -> str:
    """An expression; what does not fit into its line has each item on one of its own.

    Args:
        value: what to write.
        indent: of its line.
        around: how many other characters the line has.
    """
    if isinstance(value, Code):
        return value.text
    if isinstance(value, Call):
        named = ((name, item) for name, item in value.keywords.items() if item is not None)
        parts = [("", item) for item in value.arguments] + [
            (f"{key}=", item) for key, item in named
        ]
        return _enclosed(f"{value.name}(", parts, ")", indent, around)
    if isinstance(value, dict):
        parts = [(f"{key!r}: ", item) for key, item in value.items()]
        return _enclosed("{", parts, "}", indent, around)
    if isinstance(value, list):
        return _enclosed("[", [("", item) for item in value], "]", indent, around)
    if isinstance(value, tuple):
        return "(" + ", ".join(render(item, indent) for item in value) + ")"
    if isinstance(value, float) and not math.isfinite(value):
        return f"float({str(value)!r})"
    return repr(value)


def _enclosed(
    opening: str, parts: list[tuple[str, object]], closing: str, indent: int, around: int
) -> str:
    comments = any(isinstance(item, Call) and item.comments for _, item in parts)
    line = opening + ", ".join(f"{key}{render(item, indent)}" for key, item in parts) + closing
    if not comments and "\n" not in line and len(line) + indent + around <= WIDTH:
        return line
    if len(parts) == 1 and not comments and not parts[0][0]:
        return opening + render(parts[0][1], indent, around + len(opening) + 1) + closing
    space = " " * (indent + 4)
    lines = []
    for key, item in parts:
        if isinstance(item, Call):
            for comment in item.comments:
                lines += comment_lines(comment, indent + 4)
        lines.append(f"{space}{key}{render(item, indent + 4, len(key) + 1)},")
    return "\n".join([opening, *lines, " " * indent + closing])


def names(value: object) -> Iterator[str]:
    """What an expression refers to."""
    if isinstance(value, Code):
        yield value.text
    elif isinstance(value, Call):
        yield value.name
        for item in (*value.arguments, *value.keywords.values()):
            yield from names(item)
    elif isinstance(value, dict):
        for item in value.values():
            yield from names(item)
    elif isinstance(value, list | tuple):
        for item in value:
            yield from names(item)


def comment_lines(text: str, indent: int) -> list[str]:
    """A text as lines of a comment."""
    begin = " " * indent + "# "
    return textwrap.wrap(
        one_line(text), WIDTH, initial_indent=begin, subsequent_indent=begin, break_on_hyphens=False
    )


def one_line(text: str) -> str:
    """A text as part of one line of a comment or a docstring: nothing in it ends either."""
    printable = "".join(char if char.isprintable() else " " for char in text)
    return " ".join(printable.replace("\\", "/").replace('"""', "'''").split())
