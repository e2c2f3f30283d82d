"""Parsing the references ``$(var name)`` and ``$(env NAME)`` in a text."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Literal

import msgspec

OPENING = "$("

_REFERENCE = re.compile(r"\$\(\s*(var|env)\s+([A-Za-z_][A-Za-z0-9_]*)\s*\)")
_UNPARSED_REFERENCE = re.compile(r"\$\([^()\s]*(?:\s+[^()]*)?\)?")


class Reference(msgspec.Struct, frozen=True):
    """A reference, at ``text[start:end]``; its name begins at `name_start`."""

    start: int
    end: int
    kind: Literal["var", "env"]
    name: str
    name_start: int


class MalformedReference(msgspec.Struct, frozen=True):
    """Text at ``text[start:end]`` that begins like a reference but is not one."""

    start: int
    end: int
    message: str
    help: str


def references(text: str) -> Iterator[Reference | MalformedReference]:
    """Everything in `text` that begins with ``$(``, from left to right."""
    at = text.find(OPENING)
    while at >= 0:
        match = _REFERENCE.match(text, at)
        if match is not None:
            kind: Literal["var", "env"] = "var" if match[1] == "var" else "env"
            yield Reference(at, match.end(), kind, match[2], match.start(2))
            at = text.find(OPENING, match.end())
        else:
            broken = _malformed(text, at)
            yield broken
            at = text.find(OPENING, max(broken.end, at + 2))


def _malformed(text: str, at: int) -> MalformedReference:
    rough = _UNPARSED_REFERENCE.match(text, at)
    end = rough.end() if rough is not None else at + 2
    inside = text[at + 2 : end].removesuffix(")")
    word, _, rest = inside.strip().partition(" ")
    if not text[at:end].endswith(")"):
        return MalformedReference(at, end, "unclosed '$('", "close it with ')'")
    if word in ("var", "env"):
        return MalformedReference(
            at,
            end,
            f"$({word} ...) needs one name of letters, digits and underscores",
            f"for example: $({word} rate)" if word == "var" else "for example: $(env HOME)",
        )
    if word in ("arg", "param") and rest:
        return MalformedReference(
            at, end, f"'$({word} ...)' is not supported", f"write $(var {rest.strip()})"
        )
    if word == "optenv" and rest:
        return MalformedReference(
            at, end, "'$(optenv ...)' is not supported", f"write $(env {rest.split()[0]})"
        )
    return MalformedReference(
        at,
        end,
        "unknown reference; only $(var name) and $(env NAME) are supported",
        "for computed values, let a script write the spec, or pass them with --var",
    )
