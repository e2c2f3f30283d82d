"""Decoding JSON with limits on size, depth and numbers; each problem is a `DecodeError`.

JSON allows numbers of any size. Arithmetic on them overflows somewhere, far from the file that is
to blame; so they are refused where the file is read.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any, Final, TypeVar

import msgspec

from r2bspec.safe_io import limits
from r2bspec.safe_io.safe_file import read_bytes

_LIMITS: Final = {float: limits.MAX_NUMBER, int: limits.MAX_INTEGER}
_WHOLES: Final = (msgspec.Struct, dict, list, tuple)


def check_values(value: Any, free: frozenset[str] = frozenset()) -> None:
    """Check that no number inside a decoded value is out of range.

    Args:
        value: what was decoded.
        free: fields whose values are only passed on, such as the parameters of nodes.

    Raises:
        ValueError: one is; the message has the way to it.
    """
    # A place is that of what is around it, this, and a position: most are never written.
    waiting: list[tuple[Any, Any]] = [(None, (value,))]
    while waiting:
        around, whole = waiting.pop()
        for position, part in enumerate(_parts(whole, free)):
            limit = _LIMITS.get(type(part))
            if limit is not None:
                if not -limit <= part <= limit:  # or NaN
                    path = _path((around, whole, position))
                    raise ValueError(f"a number is out of range at {path}")
            elif isinstance(part, _WHOLES):
                waiting.append(((around, whole, position), part))


def _parts(whole: Any, free: frozenset[str]) -> Iterable[Any]:
    """Return the values in another; None for a field that is free."""
    if isinstance(whole, msgspec.Struct):
        names = whole.__struct_fields__
        return [None if name in free else getattr(whole, name) for name in names]
    if isinstance(whole, dict):
        return itertools.chain.from_iterable(whole.items())
    parts: Iterable[Any] = whole
    return parts


def _path(place: tuple[Any, Any, int]) -> str:
    around, whole, position = place
    if around is None:
        return "$"
    if isinstance(whole, msgspec.Struct):
        return f"{_path(around)}.{whole.__struct_fields__[position]}"
    return f"{_path(around)}[{'...' if isinstance(whole, dict) else position}]"


T = TypeVar("T")


def read_json(path: Path, kind: type[T], *, max_bytes: int = limits.MAX_JSON_BYTES) -> T:
    """Read a value from a file.

    Raises:
        RefusedFileError: the file is no regular file, or too large.
        OSError: the system refuses.
        msgspec.DecodeError: as `decode_json`.
    """
    return decode_json(read_bytes(path, max_bytes=max_bytes), kind)


def decode_json(
    content: bytes,
    kind: type[T],
    *,
    dec_hook: Callable[[type, Any], Any] | None = None,
    free: frozenset[str] = frozenset(),
) -> T:
    """Decode a value.

    Args:
        content: the document.
        kind: the type of the value.
        dec_hook: as for `msgspec.json.decode`.
        free: fields whose values are only passed on; all others are checked (`check_values`).

    Raises:
        msgspec.ValidationError: it is JSON, but not of this type, or a number is out of range.
        msgspec.DecodeError: it is not JSON or not UTF-8, or nested too deeply.
    """
    try:
        value = msgspec.json.decode(content, type=kind, dec_hook=dec_hook)
    except RecursionError:
        raise msgspec.DecodeError("it is nested too deeply") from None
    except UnicodeDecodeError as error:
        raise msgspec.DecodeError(f"it is not UTF-8 (byte {error.start})") from None
    try:
        check_values(value, free)
    except ValueError as error:
        raise msgspec.ValidationError(str(error)) from None
    return value
