"""Decoding JSON with limits on size, depth, texts and numbers; each problem is a `DecodeError`.

JSON allows numbers of any size. Arithmetic on them overflows somewhere, far from the file that is
to blame; so they are refused where the file is read.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

import msgspec

from r2bspec.safe_io import limits
from r2bspec.safe_io.safe_file import read_bytes


def check_values(value: Any, free: frozenset[str] = frozenset()) -> None:
    """Check that no number inside a decoded value is out of range, and no text too long.

    Args:
        value: what was decoded.
        free: fields whose values are only passed on, such as the parameters of nodes.

    Raises:
        ValueError: one is; the message has the way to it.
    """
    # A place is the one around it and a name: most are never written.
    waiting: list[tuple[Any, Any]] = [("$", value)]
    while waiting:
        place, given_value = waiting.pop()
        if isinstance(given_value, str) and len(given_value) > limits.MAX_TEXT_CHARACTERS:
            raise ValueError(
                f"a text has more than {limits.MAX_TEXT_CHARACTERS:,} characters at {_path(place)}"
            )
        if isinstance(given_value, bool | str | bytes) or given_value is None:
            continue
        if isinstance(given_value, int | float):
            limit = limits.MAX_INTEGER if isinstance(given_value, int) else limits.MAX_NUMBER
            if (
                not -limit <= given_value <= limit and given_value == given_value
            ):  # NaN is a number of its own
                raise ValueError(f"a number is out of range at {_path(place)}")
        elif isinstance(given_value, msgspec.Struct):
            waiting += [
                ((place, f".{name}"), getattr(given_value, name))
                for name in given_value.__struct_fields__
                if name not in free
            ]
        elif isinstance(given_value, dict):
            waiting += [((place, "[...]"), item) for pair in given_value.items() for item in pair]
        elif isinstance(given_value, list | tuple):
            waiting += [((place, number), one) for number, one in enumerate(given_value)]


def _path(place: Any) -> str:
    if isinstance(place, str):
        return place
    around, name = place
    return f"{_path(around)}{f'[{name}]' if isinstance(name, int) else name}"


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
