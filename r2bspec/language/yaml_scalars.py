"""The value of an unquoted scalar by the core schema of YAML 1.2, and plain data as YAML.

YAML 1.1, which PyYAML implements, turns ``on`` and ``no`` into booleans, ``12:30`` into 750 and
``010`` into 8. Here they are strings, and so are dates. There is one deliberate deviation from the
core schema: ``010`` is neither 8 nor 10 but text, because readers disagree about it. What is
written, `resolve` reads back unchanged.
"""

from __future__ import annotations

import math
import re
from typing import Any

import yaml

ScalarValue = bool | int | float | str | None

_CONSTANTS: dict[str, ScalarValue] = {
    "": None,
    "~": None,
    **dict.fromkeys(("null", "Null", "NULL"), None),
    **dict.fromkeys(("true", "True", "TRUE"), True),
    **dict.fromkeys(("false", "False", "FALSE"), False),
}
_MAYBE_NUMBER = frozenset("+-.0123456789")
_DECIMAL = re.compile(r"[-+]?(?:0|[1-9][0-9]*)")
_PREFIXED_INT = re.compile(r"0o[0-7]+|0x[0-9a-fA-F]+")
_FLOAT = re.compile(r"[-+]?(?:\.[0-9]+|(?:0|[1-9][0-9]*)(?:\.[0-9]*)?)(?:[eE][-+]?[0-9]+)?")
_NOT_FINITE = re.compile(r"[-+]?\.(?:inf|Inf|INF)|\.(?:nan|NaN|NAN)")

_MAX_INT = 2**63 - 1
_MAX_INT_CHARS = 25  # characters, prefix and sign included, of any integer within 64 bits


class ScalarError(ValueError):
    """A number that is not supported in specs."""


def resolve(text: str) -> ScalarValue:
    """The value of an unquoted scalar.

    Raises:
        ScalarError: an integer that exceeds 64 bits, or a number that is not finite.
    """
    if text[:1] not in _MAYBE_NUMBER:
        return _CONSTANTS.get(text, text)
    if _DECIMAL.fullmatch(text):
        return _integer(text, 10)
    if _PREFIXED_INT.fullmatch(text):
        return _integer(text, 0)
    if _FLOAT.fullmatch(text):
        return _finite(float(text))
    if _NOT_FINITE.fullmatch(text):
        return _finite(math.inf)
    return text


def _integer(text: str, base: int) -> int:
    # The length is checked first: Python needs quadratic time for long digit strings.
    if len(text) <= _MAX_INT_CHARS:
        value = int(text, base)
        if -_MAX_INT - 1 <= value <= _MAX_INT:
            return value
    raise ScalarError("an integer that exceeds 64 bits")


def _finite(value: float) -> float:
    # Plans and results are JSON, which cannot represent these.
    if math.isfinite(value):
        return value
    raise ScalarError("not a finite number")


class _Dumper(yaml.SafeDumper):
    """Writes shared values in full, and quotes what YAML 1.1 or YAML 1.2 would not read as text."""

    def ignore_aliases(self, data: object) -> bool:
        del data
        return True


def _represent_text(dumper: _Dumper, data: str) -> yaml.ScalarNode:
    return dumper.represent_scalar("tag:yaml.org,2002:str", data, style=_style(data))


def _style(data: str) -> str | None:
    try:
        return None if isinstance(resolve(data), str) else "'"
    except ScalarError:
        return "'"


_Dumper.add_representer(str, _represent_text)


def to_yaml(plain: Any) -> str:
    """The YAML text of dicts, lists and scalars; keys keep their order."""
    written: str = yaml.dump(plain, Dumper=_Dumper, sort_keys=False, allow_unicode=True, width=100)
    return written
