"""References in launch files of XML and YAML, such as ``$(var side)`` and ``$(eval 'a' == 'b')``.

They may be nested. Those that depend on the machine stay references, as in
`r2bspec.interop.script_import.foreign_calls`.
"""

from __future__ import annotations

import shlex
from collections.abc import Mapping
from typing import Any, Final

from r2bspec.interop.script_import.launch_conditions import (
    all_of,
    any_of,
    expression_value,
    truth_of,
)

_MAX_DEPTH: Final = 10


def substituted(text: str, values: Mapping[str, Any], depth: int = 0) -> str | None:
    """A text with its references replaced; None if the value of one is not known.

    Args:
        text: of the launch file.
        values: the arguments and variables of the file, by name.
        depth: of references inside references.
    """
    if depth > _MAX_DEPTH:
        return None
    parts: list[str] = []
    while "$(" in text:
        before, _, rest = text.partition("$(")
        end = _closing(rest)
        if end is None:
            return None
        inner = substituted(rest[:end], values, depth + 1)
        value = None if inner is None else _reference(inner, values)
        if value is None:
            return None
        parts += [before, value]
        text = rest[end + 1 :]
    return "".join([*parts, text])


def _closing(text: str) -> int | None:
    """The offset of the bracket that closes one before the text."""
    depth = 0
    for offset, character in enumerate(text):
        depth += (character == "(") - (character == ")")
        if depth < 0:
            return offset
    return None


def _reference(inner: str, values: Mapping[str, Any]) -> str | None:
    kind, _, rest = inner.partition(" ")
    if kind == "eval":
        return _word(expression_value(_unquoted(rest.strip())))
    try:
        words = shlex.split(rest)
    except ValueError:
        return None
    match kind, words:
        case "dirname", []:
            return "$(script)"
        case "var", [name, *default]:
            value = values.get(name, default[0] if default else None)
            return str(value) if isinstance(value, str | int | float) else None
        case "find-pkg-share", [package]:
            return f"$(share {package})"
        case (("env" | "optenv"), [name, *_]):
            return f"$(env {name})"
        case "not", [word]:
            decided = truth_of(word)
            return _word(None if decided is None else not decided)
        case (("equals" | "not-equals"), [left, right]):
            # What only the machine decides cannot be compared here.
            known = "$(" not in left + right
            return _word((left == right) is (kind == "equals")) if known else None
        case "and", [*words]:
            return _word(all_of([truth_of(each) for each in words]))
        case "or", [*words]:
            return _word(any_of([truth_of(each) for each in words]))
    return None


def _unquoted(text: str) -> str:
    """An expression without the quotes around the whole of it."""
    if len(text) > 1 and text[0] == text[-1] in {'"', "'"} and text[0] not in text[1:-1]:
        return text[1:-1]
    return text


def _word(decided: bool | None) -> str | None:
    return None if decided is None else str(decided).lower()
