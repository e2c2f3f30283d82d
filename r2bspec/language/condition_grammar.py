"""The grammar of a condition on the content of a message, such as ``len(detections) > 0``.

Grammar (white space between tokens is free)::

    condition = ( path | "len(" path ")" ) op literal
    path      = field { "." field | "[" ( digits | "*" ) "]" }
    op        = "<" | "<=" | ">" | ">=" | "==" | "!="
    literal   = number | "true" | "false" | "'" text "'" | constant
    field     = letter { letter | digit | "_" }
    constant  = an upper-case name that the message type of the field declares

An item ``[*]`` is any item: the condition holds if it holds for one of them. A time or a duration
is compared as seconds. What fields a message has, this module does not know.
"""

from __future__ import annotations

import re
from functools import lru_cache
from typing import ClassVar, Final, Literal

from r2bspec.language.requirement_grammar import Operator, ParsedText, RequirementError
from r2bspec.safe_io.limits import MAX_REQUIREMENT_CHARACTERS

Step = str | int
"""Of a path: a field, the number of an item, or ``*`` for any item."""

_EXAMPLE: Final = "len(detections) > 0"
_FIELD: Final = "[A-Za-z][A-Za-z0-9_]*"
_PATH: Final = rf"{_FIELD}(?:\s*\.\s*{_FIELD}|\s*\[\s*(?:\d{{1,9}}|\*)\s*\])*"
_SUBJECT: Final = re.compile(rf"\s*(?:len\s*\(\s*(?P<listed>{_PATH})\s*\)|(?P<path>{_PATH}))\s*")
_STEP: Final = re.compile(rf"{_FIELD}|\d+|\*")
_OPERATOR: Final = re.compile(r"<=|>=|==|!=|<|>")
_NUMBER: Final = re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d{1,3})?")
_TEXT: Final = re.compile(r"'(?P<single>[^']*)'|\"(?P<double>[^\"]*)\"")
_CONSTANT: Final = re.compile(r"[A-Z][A-Z0-9_]*")


class ConditionError(RequirementError):
    """A text that is not a condition, with where it ceases to be one."""


class Constant(str):
    """The name of a constant, in place of its value."""

    __slots__ = ()


class Condition(ParsedText):
    """One parsed condition.

    Attributes:
        text: as the user wrote it.
        path: to the field.
        of_length: whether the number of items, or of characters, is compared.
        op: the comparison.
        literal: what the value is compared with.
        path_column: offset of the path into `text`.
        literal_column: offset of the literal into `text`.
    """

    __slots__ = ("literal", "literal_column", "of_length", "op", "path", "path_column")

    kind: ClassVar[str] = "condition on a message"
    example: ClassVar[str] = _EXAMPLE

    def __init__(
        self,
        *,
        text: str,
        path: tuple[Step, ...],
        of_length: bool,
        op: Operator,
        literal: float | bool | str,
        path_column: int = 0,
        literal_column: int = 0,
    ) -> None:
        super().__init__(text)
        self.path = path
        self.of_length = of_length
        self.op: Operator = op
        self.literal = literal
        self.path_column = path_column
        self.literal_column = literal_column

    @classmethod
    def parse(cls, text: str) -> Condition:
        """Parse one condition, as `parse_condition` does."""
        return parse_condition(text)


@lru_cache(maxsize=1024)
def parse_condition(text: str) -> Condition:
    """Parse one condition.

    Raises:
        ConditionError: the text is not a condition; with the offset of the first error.
    """
    if len(text) > MAX_REQUIREMENT_CHARACTERS:
        raise ConditionError(
            f"the condition has more than {MAX_REQUIREMENT_CHARACTERS} characters", 0
        )
    subject = _SUBJECT.match(text)
    if subject is None:
        column = len(text) - len(text.lstrip())
        raise ConditionError("expected the path of a field", column, _EXAMPLE)
    part: Literal["listed", "path"] = "path" if subject["path"] else "listed"
    path = subject[part]
    compared = _OPERATOR.match(text, subject.end())
    if compared is None and text[subject.end() :].lstrip().startswith("["):
        at = text.index("[", subject.end())
        raise ConditionError("expected an index from 0 to 999999999, or *", at, f"{path}[0] > 1")
    if compared is None:
        meant = f"len({path})" if part == "listed" else path
        raise ConditionError(
            f"expected one of < <= > >= == != after {meant!r}",
            min(subject.end(), len(text)),
            f"{meant} == true" if part == "path" else f"{meant} > 0",
        )
    column = compared.end() + len(text[compared.end() :]) - len(text[compared.end() :].lstrip())
    return Condition(
        text=text,
        path=tuple(int(step) if step.isdecimal() else step for step in _STEP.findall(path)),
        of_length=part == "listed",
        op=compared[0],  # type: ignore[arg-type]  # the pattern admits only operators
        literal=_literal(text[column:].rstrip(), column),
        path_column=subject.start(part),
        literal_column=column,
    )


def _literal(text: str, column: int) -> float | bool | str:
    if text in {"true", "false"}:
        return text == "true"
    if _NUMBER.fullmatch(text):
        return int(text) if re.fullmatch(r"[+-]?\d{1,19}", text) else float(text)
    if (quoted := _TEXT.fullmatch(text)) is not None:
        return quoted["double"] if quoted["single"] is None else quoted["single"]
    if _CONSTANT.fullmatch(text):
        return Constant(text)
    raise ConditionError(
        "expected a number, true, false, a text in quotes, or a constant of the message type",
        column,
        f"'{text}'" if text and "'" not in text else "0",
    )
