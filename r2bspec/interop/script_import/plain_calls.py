"""Python's own functions, methods and operators, on values that are known."""

from __future__ import annotations

import ast
import operator
import posixpath
import re
from collections.abc import Callable
from typing import Any, Final

from r2bspec.interop.script_import.script_limits import MAX_ITEMS, MAX_TEXT, ScriptLimitError
from r2bspec.interop.script_import.script_values import ImageSize

_FUNCTIONS: dict[str, Callable[..., Any]] = {
    "str": lambda value="": _as_text(value),
    "int": int,
    "float": float,
    "bool": bool,
    "len": len,
    "list": list,
    "tuple": tuple,
    "dict": dict,
    "sorted": sorted,
    "reversed": lambda value: list(reversed(value)),
    "zip": lambda *values: list(zip(*values, strict=False)),
    "enumerate": lambda values, start=0: list(enumerate(values, start)),
    "min": min,
    "max": max,
    "sum": sum,
    "abs": abs,
    "round": round,
    "repr": repr,
}

_METHODS: dict[type, frozenset[str]] = {
    str: frozenset(
        [
            "lower",
            "upper",
            "strip",
            "lstrip",
            "rstrip",
            "split",
            "rsplit",
            "splitlines",
            "join",
            "replace",
            "startswith",
            "endswith",
            "format",
            "title",
            "capitalize",
            "removeprefix",
            "removesuffix",
            "partition",
            "rpartition",
            "zfill",
        ]
    ),
    list: frozenset(
        ["append", "extend", "insert", "copy", "index", "count", "pop", "remove", "reverse"]
    ),
    dict: frozenset(["items", "keys", "values", "get", "update", "copy", "setdefault", "pop"]),
    tuple: frozenset(["index", "count"]),
}
"""Methods without effects on anything but the object itself."""

_BINARY: dict[type, Callable[[Any, Any], Any]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
    ast.FloorDiv: operator.floordiv,
    ast.Mod: operator.mod,
    ast.BitOr: operator.or_,
}
COMPARISONS: Final[dict[type, Callable[[Any, Any], bool]]] = {
    ast.Eq: operator.eq,
    ast.NotEq: operator.ne,
    ast.Lt: operator.lt,
    ast.LtE: operator.le,
    ast.Gt: operator.gt,
    ast.GtE: operator.ge,
    ast.In: lambda left, right: left in right,
    ast.NotIn: lambda left, right: left not in right,
}
"""Comparisons of values; those of identity are for scripts alone."""
_COMPARED = COMPARISONS | {ast.Is: operator.is_, ast.IsNot: operator.is_not}


_LARGE_WIDTH = re.compile(r"[0-9]{4,}")
"""A field of a format that would be padded to thousands of characters."""


class NotSupportedError(Exception):
    """An operation that is not in these tables, or fails."""


def check_size(*values: Any) -> None:
    """Check that values are no larger than the limits, with everything that they contain.

    A list of ten levels, each of which has the one below twice, is small in memory only.

    Raises:
        ScriptLimitError: they are.
    """
    waiting, seen = list(values), 0
    while waiting:
        each = waiting.pop()
        seen += 1
        if isinstance(each, list | tuple):
            waiting.extend(each)
        elif isinstance(each, dict):
            waiting.extend(each.values())
        if seen + len(waiting) > 2 * MAX_ITEMS:
            raise ScriptLimitError(f"more than {2 * MAX_ITEMS:,} items")


def call_function(name: str, arguments: list[Any], keywords: dict[str, Any]) -> Any:
    """The result of one of Python's own functions.

    Raises:
        NotSupportedError: it is not one of those, or raises.
    """
    if name == "range":
        return _range(arguments)
    known = _FUNCTIONS.get(name)
    if known is None:
        raise NotSupportedError
    check_size(arguments, keywords)
    return _checked(lambda: known(*arguments, **keywords))


def has_function(name: str) -> bool:
    """Whether a name is one of Python's own functions that are known here."""
    return name == "range" or name in _FUNCTIONS


def call_method(owner: Any, name: str, arguments: list[Any], keywords: dict[str, Any]) -> Any:
    """The result of a method of a text, list, tuple or map.

    Raises:
        NotSupportedError: it is not known here, or raises.
    """
    if name in {"perform", "evaluate", "as_posix"}:
        # Of a launch substitution whose value is known, or of a path.
        return str(owner) if isinstance(owner, str) else owner
    kind = next((each for each in _METHODS if isinstance(owner, each)), None)
    if kind is None or name not in _METHODS[kind]:
        raise NotSupportedError
    if name in {"format", "zfill"} and _LARGE_WIDTH.search(f"{owner} {arguments}"):
        raise NotSupportedError
    check_size(owner, arguments, keywords)
    result = _checked(lambda: getattr(owner, name)(*arguments, **keywords))
    if name in {"items", "keys", "values"}:
        return list(result)
    return result


def has_method(owner: Any, name: str) -> bool:
    """Whether a method is known here."""
    return name in {"perform", "evaluate", "as_posix"} or any(
        isinstance(owner, kind) and name in names for kind, names in _METHODS.items()
    )


def binary(kind: type, left: Any, right: Any) -> Any:
    """The result of a binary operator.

    Raises:
        NotSupportedError: it is not supported, or raises.
    """
    if kind is ast.Div and isinstance(left, str) and isinstance(right, str):
        return posixpath.join(left, right)
    if kind is ast.Mult and any(isinstance(each, str | list | tuple) for each in (left, right)):
        _check_repetition(left, right)
    if kind is ast.Mod and isinstance(left, str) and _LARGE_WIDTH.search(left):
        raise NotSupportedError
    check_size(left, right)
    known = _BINARY.get(kind)
    if known is None:
        raise NotSupportedError
    return _checked(lambda: known(left, right))


def compare(kind: type, left: Any, right: Any) -> Any:
    """The result of a comparison; errors as for `binary`."""
    known = _COMPARED.get(kind)
    if known is None:
        raise NotSupportedError
    check_size(left, right)
    return _checked(lambda: known(left, right))


def _checked(call: Callable[[], Any]) -> Any:
    try:
        result = call()
    except (TypeError, ValueError, KeyError, IndexError, ArithmeticError, AttributeError) as error:
        raise NotSupportedError(str(error)) from error
    if isinstance(result, str) and len(result) > MAX_TEXT:
        raise ScriptLimitError(f"a text of more than {MAX_TEXT:,} characters")
    if isinstance(result, list | tuple | dict) and len(result) > MAX_ITEMS:
        raise ScriptLimitError(f"more than {MAX_ITEMS:,} items")
    if isinstance(result, int) and not isinstance(result, bool) and result.bit_length() > 256:
        raise ScriptLimitError("a number of more than 256 bits")
    return result


def _check_repetition(left: Any, right: Any) -> None:
    times, repeated = (left, right) if isinstance(left, int) else (right, left)
    is_repeated = isinstance(times, int) and isinstance(repeated, str | list | tuple)
    if is_repeated and times * len(repeated) > MAX_ITEMS:
        raise ScriptLimitError(f"more than {MAX_ITEMS:,} items")


def _range(arguments: list[Any]) -> list[int]:
    try:
        numbers = range(*arguments)
    except (TypeError, ValueError) as error:
        raise NotSupportedError(str(error)) from error
    if len(numbers) > MAX_ITEMS:
        raise ScriptLimitError(f"a range of more than {MAX_ITEMS:,} numbers")
    return list(numbers)


def _as_text(value: Any) -> str:
    if isinstance(value, ImageSize):
        shown = f"({value.width},{value.height})"
        return f"{value.label} {shown}" if value.label else shown
    if isinstance(value, str | int | float | bool | list | tuple | dict) or value is None:
        return str(value)
    raise NotSupportedError
