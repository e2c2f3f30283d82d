"""Snippets of the schema, which are values with placeholders, as YAML in block style."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from typing import Any

from r2bspec.language.declaration import Rule

_STEP = "  "
_PLACEHOLDER = re.compile(r"\A\$\{(\d+):[^}]*\}\Z")


def snippet_text(body: Mapping[str, Any]) -> str:
    """The lines of a snippet, not indented.

    A value that is only a placeholder is left empty: an editor proposes what begins with the text
    before the cursor, and the text of a placeholder would be the beginning of nothing.

    Args:
        body: the map that is inserted, with placeholders as ``${1:name}``.
    """
    return "\n".join(_lines(body))


def key_snippet(key: str, rule: Rule) -> str:
    """A key with room for its value below it; empty where the value follows on the same line.

    Args:
        key: the key.
        rule: of its value. Required keys of a map are there already, with room for
            their values, unless these are maps or lists.
    """
    items = rule.items
    in_lines = items is not None and (items.is_parsed or items.kinds == ("object",))
    if rule.kinds == ("array",) and in_lines:
        return f"{key}:\n{_STEP}- $0"
    if rule.kinds != ("object",):
        return ""
    keys = rule.keys or {}
    if not rule.required or any(_is_collection(keys[name]) for name in rule.required):
        return f"{key}:\n{_STEP}$0"
    stops = (f"{_STEP}{name}: ${index}" for index, name in enumerate(rule.required, 1))
    return "\n".join([f"{key}:", *stops])


def _is_collection(rule: Rule) -> bool:
    return not {"object", "array"}.isdisjoint(rule.kinds)


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
        yield _PLACEHOLDER.sub(r"$\1", str(value))


def _entry(start: str, below: Any) -> Iterator[str]:
    if (isinstance(below, Mapping) and below) or (isinstance(below, list) and below):
        yield start
        yield from (_STEP + line for line in _lines(below))
    elif isinstance(below, Mapping | list):
        yield f"{start} {{}}" if isinstance(below, Mapping) else f"{start} []"
    else:
        yield f"{start} {next(_lines(below))}"
