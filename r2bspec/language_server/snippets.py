"""Snippets of the schema, which are values with placeholders, as YAML in block style."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

_STEP = "  "


def snippet_text(body: Mapping[str, Any], indent: str = "") -> str:
    """The lines of a snippet; the first one begins at the cursor.

    Args:
        body: the map that is inserted, with placeholders as ``${1:name}``.
        indent: of the cursor, for the lines after the first.
    """
    lines = list(_lines(body))
    return f"\n{indent}".join(lines)


def _lines(value: Any) -> Iterator[str]:
    if isinstance(value, Mapping):
        for key, below in value.items():
            yield from _entry(f"{key}:", below)
    elif isinstance(value, list):
        for item in value:
            first, *rest = _lines(item)
            yield f"- {first}"
            yield from (_STEP + line for line in rest)
    elif isinstance(value, bool):
        yield str(value).lower()
    else:
        yield str(value)


def _entry(start: str, below: Any) -> Iterator[str]:
    if (isinstance(below, Mapping) and below) or (isinstance(below, list) and below):
        yield start
        yield from (_STEP + line for line in _lines(below))
    elif isinstance(below, Mapping | list):
        yield f"{start} {{}}" if isinstance(below, Mapping) else f"{start} []"
    else:
        yield f"{start} {next(_lines(below))}"
