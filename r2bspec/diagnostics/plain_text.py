"""Making text of unknown origin harmless for a terminal, a log and a pipeline.

Three things do harm. Control characters, among them escape sequences, change the display or the
title of a terminal. Bidirectional marks show text in another order. A line that begins with ``::``,
or has ``##[`` anywhere, is a command to the runner of a workflow.
"""

from __future__ import annotations

import re
from functools import cache
from typing import Any, Final, TypeVar

import msgspec

T = TypeVar("T")

REPLACEMENT: Final = "\N{REPLACEMENT CHARACTER}"

_BIDI = "\u061c\u200e\u200f\u202a-\u202e\u2066-\u2069"
# Line feed and tab stay, and a carriage return before a line feed.
_CONTROL = rf"\r(?!\n)|[\x00-\x08\x0b\x0c\x0e-\x1f\x7f-\x9f\u2028\u2029\ufeff\ud800-\udfff{_BIDI}]"
_ANY_CONTROL = re.compile(_CONTROL)
_NOT_ESCAPED = re.compile(rf"[\x7f-\x9f\u2028\u2029\ufeff\ud800-\udfff{_BIDI}]")
_STYLE = re.compile(r"(\x1b\[[0-9;]*m)")
# The runner ignores space before a command; our own styles may be there, too.
_LINE_COMMAND = re.compile(r"(?m)^((?:\x1b\[[0-9;]*m|[^\S\n])*):(?=:)")
_MARK_COMMAND = re.compile(r"#(?=#\w*\[)")
_DETAILS = re.compile(r"(:|(?=\n  ))\n")
_MARK_COMMAND_OF_JSON = re.compile(rb"#(?=#\w*\[)")


def plain(text: str) -> str:
    """Return the text with every character that controls a terminal replaced; lines stay."""
    if text.isascii() and text.isprintable():
        return text
    return _ANY_CONTROL.sub(REPLACEMENT, text)


def escaped_json(content: bytes) -> bytes:
    """Return a JSON document with escapes for what controls a terminal or a workflow runner.

    Its values are the same. Encoders escape the characters below U+0020 only; outside of texts,
    JSON has none of these, and no number sign.
    """
    content = _MARK_COMMAND_OF_JSON.sub(rb"\\u0023", content)
    if content.isascii() and b"\x7f" not in content:
        return content
    text = content.decode("utf-8", "surrogatepass")
    return _NOT_ESCAPED.sub(lambda found: f"\\u{ord(found[0]):04x}", text).encode()


def without_commands(text: str) -> str:
    """Return the text with a space inside everything that a runner would take for a command."""
    if "::" in text:
        text = _LINE_COMMAND.sub(r"\1: ", text)
    return _MARK_COMMAND.sub("# ", text) if "##" in text else text


def harmless(text: str, *, styled: bool = False, commands: bool = False) -> str:
    """Return the text without control characters and commands.

    Args:
        text: what is to be shown.
        styled: keep sequences that colour text. What has been put between them must be plain.
        commands: keep lines that begin with ``::``: r2bspec made them, and escaped their values.
    """
    if commands:
        return _MARK_COMMAND.sub("# ", plain(text))
    if styled:
        parts = _STYLE.split(text)
        parts[::2] = map(plain, parts[::2])
        return without_commands("".join(parts))
    return without_commands(plain(text))


MAX_LINE_CHARACTERS: Final = 4_000
"""The most of one line that is printed: whatever a file holds, a terminal stays usable."""


def short_lines(text: str, most: int = MAX_LINE_CHARACTERS) -> str:
    """Return the text with lines longer than `most` characters cut in their middle.

    A message ends with its reason, which may stand behind a long name.
    """
    if len(text) <= most:
        return text
    end = most // 4
    return "\n".join(
        line if len(line) <= most else f"{line[: most - end]}…{line[-end:]}"
        for line in text.split("\n")
    )


def message_text(text: str) -> str:
    """Return a message on one line, with its details indented below.

    Details, such as the last output of a process, follow a colon and a line break, or are indented
    already. Any other line break belongs to a name: it would let what follows look like a message
    of its own.
    """
    begin = _DETAILS.search(text)
    first, details = (text, "") if begin is None else (text[: begin.end(1)], text[begin.end() :])
    below = (line if line.startswith("  ") else f"  {line}" for line in details.splitlines())
    return plain("\n".join((first.replace("\n", REPLACEMENT), *below)))


def plain_values(value: T) -> T:
    """Return the value with every text in it made plain, including keys."""
    changed: Any = _plain_value(value)
    return value if changed is None else changed


@cache
def _text_fields(kind: type[msgspec.Struct]) -> tuple[str, ...]:
    """Return the fields that can contain text: most structs of a result have only numbers."""
    numbers = (bool, int, float, bool | None, int | None, float | None)
    return tuple(field.name for field in msgspec.structs.fields(kind) if field.type not in numbers)


def _plain_value(value: Any) -> Any:
    """Return a changed copy; None where nothing changes, which is the usual case."""
    if value is None or isinstance(value, float | int):
        return None
    if isinstance(value, str):
        changed = plain(value)
        return None if changed == value else changed
    if isinstance(value, dict):
        pairs = {plain_values(key): plain_values(entry) for key, entry in value.items()}
        same = all(pairs.get(key, pairs) is entry for key, entry in value.items())
        return None if same else pairs
    if isinstance(value, list | tuple):
        entries = [plain_values(entry) for entry in value]
        if all(new is old for new, old in zip(entries, value, strict=True)):
            return None
        return entries if isinstance(value, list) else tuple(entries)
    if isinstance(value, msgspec.Struct):
        fields = {name: _plain_value(getattr(value, name)) for name in _text_fields(type(value))}
        given = {name: entry for name, entry in fields.items() if entry is not None}
        return msgspec.structs.replace(value, **given) if given else None
    return None
