"""Whether a message meets a condition, read from its serialised bytes; and what a type allows.

A message is not decoded: what stands before the field in question is skipped. CDR (OMG DDS-XTypes
1.3, section 7.4.3, version 1 of the encoding): after four bytes of encapsulation each primitive is
aligned to its own size; a text is a uint32 length, including the terminating zero, and its bytes; a
sequence is a uint32 count and its items. A message without fields has one byte.

Types are written as in `r2bspec.plan.request_fields`. They come from the common interfaces, else
from the text of the installed package.
"""

from __future__ import annotations

import re
import struct
from collections.abc import Iterator, Mapping
from functools import cache
from typing import Any, Final, NamedTuple

from r2bspec.diagnostics.quote import quote, suggestion
from r2bspec.language.comparison_grammar import COMPARISONS, Condition, Constant, Step
from r2bspec.plan.installed_interfaces import fields_of_message, installed_constants
from r2bspec.plan.request_fields import FieldTypes

_LIST: Final = re.compile(r"sequence<(?P<of>.+?)(?:, \d+)?>|(?P<item>.+)\[(?P<exact>\d+)\]")
_PRIMITIVES: Final = {
    **dict.fromkeys(("boolean", "octet", "uint8", "char"), "B"),
    "int8": "b",
    "int16": "h",
    "uint16": "H",
    "int32": "i",
    "uint32": "I",
    "int64": "q",
    "uint64": "Q",
    "float": "f",
    "double": "d",
}
_TIMES: Final = {"builtin_interfaces/Time", "builtin_interfaces/Duration"}
_MAX_ITEMS: Final = 100_000
"""Of all lists that a path passes with ``[*]``, and of those that are skipped item by item."""


@cache
def message_fields(type_name: str) -> FieldTypes | None:
    """The fields of a type such as ``geometry_msgs/Pose``, in order; None if they are unknown."""
    common = _common(type_name)
    if common is not None:
        return {
            name: _written(*kind)
            for name, kind in common[1]
            if name != "structure_needs_at_least_one_member"
        }
    return fields_of_message(type_name)


def message_constants(type_name: str) -> Mapping[str, Any]:
    """The constants of a type such as ``diagnostic_msgs/DiagnosticStatus``, by name."""
    common = _common(type_name)
    if common is not None:
        return {name: value for name, _, value in common[0]}
    return installed_constants(type_name.replace("/", "/msg/"))


def _common(type_name: str) -> Any:
    from r2bspec.bags.message_types import typestore

    return typestore().fielddefs.get(type_name.replace("/", "/msg/"))


_COMMON_NAMES: Final = {
    "bool": "boolean",
    "byte": "octet",
    "char": "uint8",
    "float32": "float",
    "float64": "double",
}


def _written(kind: Any, detail: Any) -> str:
    """A type of `rosbags` as ROS's Python packages write it."""
    match kind.name:
        case "BASE":
            return _COMMON_NAMES.get(detail[0], str(detail[0]))
        case "NAME":
            return str(detail).replace("/msg/", "/")
        case "ARRAY":
            return f"{_written(*detail[0])}[{detail[1]}]"
    return f"sequence<{_written(*detail[0])}>"


class ConditionMistake(NamedTuple):
    """Why a type has no such condition.

    Attributes:
        column: offset into the text of the condition.
        message: what is wrong.
        help: what would fit; may be empty.
    """

    column: int
    message: str
    help: str


class MessageCondition(NamedTuple):
    """A condition on messages of a type that has the field.

    Attributes:
        condition: as it is written.
        type: of the messages, such as ``geometry_msgs/PoseArray``.
        literal: what is compared, a constant by its value.
    """

    condition: Condition
    type: str
    literal: Any

    def holds(self, message: bytes) -> bool:
        """Whether a serialised message, or its beginning, meets the condition.

        Raises:
            UnreadableError: the message is damaged, or cut off before the field.
        """
        compare, literal = COMPARISONS[self.condition.op], self.literal
        reader = _Reader(message)
        try:
            values = reader.values(self.type, self.condition.path, self.condition.of_length)
            return any(compare(value, literal) for value in values)
        except (struct.error, IndexError) as error:
            raise UnreadableError("the message ends before the field") from error


class UnreadableError(ValueError):
    """A message in which the field cannot be read."""


def message_condition(
    condition: Condition, type_name: str
) -> MessageCondition | ConditionMistake | None:
    """A condition on messages of a type; None if the fields of the type are unknown.

    Args:
        condition: as it is written.
        type_name: such as ``geometry_msgs/msg/PoseArray``.
    """
    kind = owner = type_name.replace("/msg/", "/")
    for step in condition.path:
        listed = _LIST.fullmatch(kind)
        if isinstance(step, int) or step == "*":
            if listed is None:
                return _mistake(condition, f"{_shown(kind)} has no items", "leave out the brackets")
            if (
                listed["exact"] is not None
                and isinstance(step, int)
                and step >= int(listed["exact"])
            ):
                return _mistake(condition, f"{kind} has no item {step}", "")
            kind = listed["of"] or listed["item"]
            continue
        fields = message_fields(kind) if "/" in kind and listed is None else {}
        if fields is None:
            return None
        if step not in fields:
            return _unknown_field(condition, step, kind, fields, is_list=listed is not None)
        owner, kind = kind, fields[step]
    return _compared(condition, kind, owner, type_name.replace("/msg/", "/"))


def _unknown_field(
    condition: Condition, step: Step, kind: str, fields: FieldTypes, *, is_list: bool
) -> ConditionMistake:
    if is_list:
        text = f"a list has no field {quote(str(step))}"
        return _mistake(condition, text, "write [0] for its first item, or [*] for any")
    known = suggestion(str(step), sorted(fields), "its fields") if fields else ""
    return _mistake(condition, f"{_shown(kind)} has no field {quote(str(step))}", known)


def _compared(
    condition: Condition, kind: str, owner: str, of: str
) -> MessageCondition | ConditionMistake:
    listed, literal = _LIST.fullmatch(kind), condition.literal
    is_text = re.fullmatch(r"string(?:<\d+>)?", kind) is not None
    if condition.of_length:
        if listed is None and not is_text:
            return _mistake(condition, f"{_shown(kind)} has no length", "leave out len()")
        expected, fits = "a number", type(literal) in {int, float}
    elif listed is not None:
        text = f"a list cannot be compared: {kind}"
        return _mistake(condition, text, "compare its len(), or an item: [0], or [*] for any")
    elif kind == "boolean":
        expected, fits = "true or false", isinstance(literal, bool)
    elif is_text:
        expected = "a text in quotes"
        fits = isinstance(literal, str) and not isinstance(literal, Constant)
    elif kind in _PRIMITIVES or kind in _TIMES:
        expected, fits = "a number", type(literal) in {int, float}
    else:
        fields = message_fields(kind) if "/" in kind else None
        known = f"one of its fields: {', '.join(fields)}" if fields else "choose another field"
        return _mistake(condition, f"{_shown(kind)} cannot be compared", known)
    if isinstance(literal, Constant):
        constants = message_constants(owner)
        if literal not in constants:
            known = suggestion(literal, sorted(constants), "its constants") if constants else ""
            text = f"{_shown(owner)} has no constant {quote(literal)}"
            return ConditionMistake(condition.literal_column, text, known)
        return MessageCondition(condition, of, constants[literal])
    if not fits:
        what = "its length" if condition.of_length else _shown(kind)
        text = f"{what} is compared with {expected}, not with {literal!r}"
        return ConditionMistake(condition.literal_column, text, "")
    return MessageCondition(condition, of, literal)


def _mistake(condition: Condition, message: str, help_text: str) -> ConditionMistake:
    return ConditionMistake(condition.path_column, message, help_text)


def _shown(kind: str) -> str:
    return kind.replace("/", "/msg/") if "/" in kind and not _LIST.fullmatch(kind) else kind


class _Reader:
    """Reads the values of a path from the bytes of a message."""

    def __init__(self, message: bytes) -> None:
        if len(message) < 4 or message[1] > 1:
            raise UnreadableError("the message is not encoded in CDR")
        self._bytes = message
        self._order = "<" if message[1] else ">"
        self._at = 4
        self._items = 0

    def values(self, kind: str, path: tuple[Step, ...], of_length: bool) -> Iterator[Any]:
        """The values of a path in a value of this type, which begins here."""
        if not path:
            yield self._length(kind) if of_length else self._value(kind)
            return
        step, rest = path[0], path[1:]
        if isinstance(step, str) and step != "*":
            yield from self._in_field(kind, step, rest, of_length)
            return
        item, count = self._items_of(kind)
        if isinstance(step, int):
            if step < count:
                self._skip_items(item, step)
                yield from self.values(item, rest, of_length)
            return
        for _ in range(count):
            self._count_item()
            begin = self._at
            yield from self.values(item, rest, of_length)
            self._at = begin
            self._skip(item)

    def _in_field(
        self, kind: str, field: str, rest: tuple[Step, ...], of_length: bool
    ) -> Iterator[Any]:
        for name, of_field in self._fields(kind).items():
            if name == field:
                yield from self.values(of_field, rest, of_length)
                return
            self._skip(of_field)

    def _fields(self, kind: str) -> FieldTypes:
        fields = message_fields(kind)
        if fields is None:
            raise UnreadableError(f"the fields of {_shown(kind)} are unknown")
        return fields or {"": "uint8"}

    def _value(self, kind: str) -> Any:
        if kind in _TIMES:
            seconds, nanoseconds = self._number("i"), self._number("I")
            return seconds + nanoseconds / 1e9
        if kind in _PRIMITIVES:
            value = self._number(_PRIMITIVES[kind])
            return bool(value) if kind == "boolean" else value
        length = self._number("I")
        content = self._bytes[self._at : self._at + length]
        if len(content) < length:
            raise IndexError
        return content.rstrip(b"\0").decode(errors="replace")

    def _length(self, kind: str) -> int:
        return len(self._value(kind)) if kind.startswith("string") else self._items_of(kind)[1]

    def _items_of(self, kind: str) -> tuple[str, int]:
        """The type of the items of a list that begins here, and their number."""
        listed = _LIST.fullmatch(kind)
        if listed is None:
            raise UnreadableError(f"{kind} has no items")
        if listed["exact"] is not None:
            return listed["item"], int(listed["exact"])
        return listed["of"], self._number("I")

    def _number(self, code: str) -> Any:
        size = struct.calcsize(code)
        self._at = 4 + -(-(self._at - 4) // size) * size
        (value,) = struct.unpack_from(f"{self._order}{code}", self._bytes, self._at)
        self._at += size
        return value

    def _skip(self, kind: str) -> None:
        if kind in _PRIMITIVES:
            self._number(_PRIMITIVES[kind])
        elif kind.startswith("string"):
            length = self._number("I")
            self._at += length
        elif _LIST.fullmatch(kind):
            self._skip_items(*self._items_of(kind))
        elif "/" in kind:
            for of_field in self._fields(kind).values():
                self._skip(of_field)
        else:
            raise UnreadableError(f"fields of type {kind} cannot be read")

    def _skip_items(self, kind: str, count: int) -> None:
        if kind in _PRIMITIVES and count:
            self._number(_PRIMITIVES[kind])
            self._at += (count - 1) * struct.calcsize(_PRIMITIVES[kind])
            return
        for _ in range(count):
            self._count_item()
            self._skip(kind)

    def _count_item(self) -> None:
        self._items += 1
        if self._items > _MAX_ITEMS:
            raise UnreadableError("too many items stand before the field")
