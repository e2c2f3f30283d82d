"""Whether the fields that a spec gives to a request, a goal or a message fit its type.

Types are written as ROS's Python packages write them: ``int32``, ``string<10>``, ``double[3]``,
``sequence<geometry_msgs/Pose, 5>``. Where a type is known from is left to the caller: a class that
is imported, or the text of an installed package.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping
from typing import Any, Final, NamedTuple

from r2bspec.diagnostics.quote import quote, suggestion

FieldTypes = Mapping[str, str]
"""The types of the fields of a message, by their names."""

FieldsOf = Callable[[str], FieldTypes | None]
"""The fields of a type such as ``geometry_msgs/Pose``; None if they are unknown."""


class FieldMistake(NamedTuple):
    """A field that does not fit.

    Attributes:
        path: the path of the field in the request: names, and places in lists.
        is_name: whether the name of the field is wrong, rather than its value.
        message: what is wrong, without the path.
        help: what would fit; may be empty.
    """

    path: tuple[str | int, ...]
    is_name: bool
    message: str
    help: str

    @property
    def where(self) -> str:
        """The path as text: ``goal.poses[2].x``."""
        return "".join(f"[{p}]" if isinstance(p, int) else f".{p}" for p in self.path)[1:]


_LIST: Final = re.compile(
    r"sequence<(?P<of>.+?)(?:, (?P<most>\d+))?>|(?P<item>.+)\[(?P<exact>\d+)\]"
)
_TEXT: Final = re.compile(r"w?string(?:<(?P<most>\d+)>)?")
_INTEGER: Final = re.compile(r"(?P<unsigned>u?)int(?P<bits>8|16|32|64)")


def field_mistakes(
    values: Mapping[str, Any],
    fields: FieldTypes,
    fields_of: FieldsOf,
    path: tuple[str | int, ...] = (),
) -> Iterator[FieldMistake]:
    """Yield the fields that do not fit, in their order.

    Args:
        values: the fields that a spec gives.
        fields: all fields of the type.
        fields_of: finds the types of fields that are messages.
        path: the path of the values in the whole request.
    """
    for name, value in values.items():
        here = (*path, name)
        if name in fields:
            yield from _value_mistakes(value, fields[name], fields_of, here)
        else:
            known = suggestion(name, sorted(fields), "its fields")
            yield FieldMistake(here, True, f"there is no field {quote(name)}", known)


def _value_mistakes(
    value: Any, type_name: str, fields_of: FieldsOf, path: tuple[str | int, ...]
) -> Iterator[FieldMistake]:
    if listed := _LIST.fullmatch(type_name):
        yield from _list_mistakes(value, type_name, listed, fields_of, path)
    elif "/" in type_name:
        fields = fields_of(type_name)
        if not isinstance(value, dict):
            known = f"its fields: {', '.join(fields)}" if fields else ""
            yield _unfit(value, type_name, path, f"write a map; {known}" if known else "")
        elif fields is not None:
            yield from field_mistakes(value, fields, fields_of, path)
    elif (why := _scalar_mistake(value, type_name)) is not None:
        yield _unfit(value, type_name, path, why)


def _list_mistakes(
    value: Any,
    type_name: str,
    listed: re.Match[str],
    fields_of: FieldsOf,
    path: tuple[str | int, ...],
) -> Iterator[FieldMistake]:
    exact, most = listed["exact"], listed["most"]
    if not isinstance(value, list):
        yield _unfit(value, type_name, path, "write a list")
    elif exact is not None and len(value) != int(exact):
        yield FieldMistake(path, False, f"it has {len(value)} items, and needs {exact}", "")
    elif most is not None and len(value) > int(most):
        yield FieldMistake(path, False, f"it has {len(value)} items, and at most {most} fit", "")
    else:
        item = listed["of"] or listed["item"]
        for index, element in enumerate(value):
            yield from _value_mistakes(element, item, fields_of, (*path, index))


def _scalar_mistake(value: Any, type_name: str) -> str | None:
    """Return how a value would fit a type that is neither a list nor a message; None if it does."""
    if type_name == "boolean":
        return None if isinstance(value, bool) else "write true or false"
    if text := _TEXT.fullmatch(type_name):
        if not isinstance(value, str):
            return "write it in quotes, as text"
        most = text["most"]
        return f"at most {most} characters fit" if most and len(value) > int(most) else None
    if type_name in {"float", "double"}:
        return None if type(value) in {int, float} else "write a number"
    if integer := _INTEGER.fullmatch(type_name):
        low, high = _range(int(integer["bits"]), is_signed=not integer["unsigned"])
        fits = type(value) is int and low <= value <= high
        return None if fits else f"write an integer from {low} to {high}"
    return "a spec cannot write a byte" if type_name == "octet" else None


def _range(bits: int, *, is_signed: bool) -> tuple[int, int]:
    return (-(1 << bits - 1), (1 << bits - 1) - 1) if is_signed else (0, (1 << bits) - 1)


def _unfit(value: Any, type_name: str, path: tuple[str | int, ...], fitting: str) -> FieldMistake:
    return FieldMistake(path, False, f"it cannot be {value!r}: its type is {type_name}", fitting)
