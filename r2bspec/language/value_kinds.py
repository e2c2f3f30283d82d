"""Validation of quantities and requirements, which JSON Schema alone cannot validate."""

from __future__ import annotations

import re
from typing import Any

import msgspec

from r2bspec.language.quantities import Quantity, QuantityError, Share
from r2bspec.language.requirement_grammar import RequirementError, parse_requirement
from r2bspec.language.schema.schema_builder import ALLOWED_WORDS, KIND, POSITIVE, QUANTITIES


class ValueProblem(msgspec.Struct, frozen=True):
    """Why a value is invalid.

    Attributes:
        column: offset into the text at which the problem begins, or None for all of the text.
        repair: text with the same meaning that could replace the value.
    """

    code: str
    message: str
    help: str = ""
    column: int | None = None
    repair: str = ""


def check_value(value: object, schema: dict[str, Any]) -> ValueProblem | None:
    """Check a value against the annotations of `schema.schema_builder`; None if it is valid."""
    kind = schema[KIND]
    if kind == "requirement":
        return _requirement(value)
    if value in schema.get(ALLOWED_WORDS, ()):
        return None
    return _quantity(value, QUANTITIES[kind], positive=schema.get(POSITIVE, False))


def _quantity(value: object, kind: type[Quantity], *, positive: bool) -> ValueProblem | None:
    if isinstance(value, int | float) and not isinstance(value, bool):
        return _missing_unit(str(value), kind)
    if not isinstance(value, str):
        return ValueProblem("R2B103", f"expected a {kind.kind}, such as {kind.example}")
    try:
        parsed = kind.parse(value)
    except QuantityError as error:
        if re.fullmatch(r"[+-]?\s*\d+(?:\.\d+)?", value.strip()):
            return _missing_unit(value.strip(), kind)
        repair = error.suggestion if error.is_equivalent else ""
        return ValueProblem(
            "R2B110", str(error), _suggestion_help(error.suggestion, repair), repair=repair
        )
    if positive and not parsed > type(parsed).parse(f"0 {next(iter(kind.units))}"):
        return ValueProblem(
            "R2B111", f"the {kind.kind} must be more than zero", _suggestion_help(kind.example)
        )
    return None


def _missing_unit(number: str, kind: type[Quantity]) -> ValueProblem:
    unit = next(iter(kind.units))
    if number.startswith("-"):
        return ValueProblem(
            "R2B110", f"a {kind.kind} cannot be negative", _suggestion_help(kind.example)
        )
    message = f"{number} has no unit; {kind.units_text()}"
    # 0.02 may mean 2 %, so there is no safe repair of a share.
    if kind is Share:
        return ValueProblem("R2B109", message, f"write {number} {unit} if that is the meaning")
    return ValueProblem("R2B109", message, f"write {number} {unit}", repair=f"{number} {unit}")


def _requirement(value: object) -> ValueProblem | None:
    if not isinstance(value, str):
        return ValueProblem("R2B103", "expected a requirement", "for example: latency.p99 < 50 ms")
    try:
        parse_requirement(value)
    except RequirementError as error:
        return ValueProblem(
            "R2B112", str(error), _suggestion_help(error.suggestion), column=error.column
        )
    return None


def _suggestion_help(text: str, repair: str = "") -> str:
    if not text:
        return ""
    return f"write {text}" if text == repair else f"for example: {text}"
