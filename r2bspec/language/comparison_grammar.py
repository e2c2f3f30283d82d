"""The requirements of a spec: comparisons of a metric with a bound.

Grammar (white space between tokens is free)::

    requirement = "sustained" | metric op bound
    metric      = [monitor "."] name ["." part]
    bound       = quantity | integer | share " of " ( "offered" | "baseline" )
    op          = "<" | "<=" | ">" | ">=" | "==" | "!="
    name, part, monitor = letter { letter | digit | "_" }

Which metrics there are, this module does not know (`r2bspec.judge.measure.metric_catalogue`).
"""

from __future__ import annotations

import contextlib
import operator
import re
from collections.abc import Callable, Mapping
from functools import lru_cache
from typing import Any, ClassVar, Literal, TypeVar, dataclass_transform

import msgspec

from r2bspec.diagnostics.quote import did_you_mean, quote
from r2bspec.language.quantities import QUANTITIES, Quantity, QuantityError, Share
from r2bspec.safe_io.limits import MAX_REQUIREMENT_CHARACTERS

_Q = TypeVar("_Q", bound=Quantity)
Operator = Literal["<", "<=", ">", ">=", "==", "!="]

_WORD = "[A-Za-z][A-Za-z0-9_]*"
# The first word may be a topic, without the slash that it begins with.
_METRIC = re.compile(rf"\s*(?P<metric>{_WORD}(?:/{_WORD})*(?:\.{_WORD})*)")
_OPERATOR = re.compile(r"\s*(?P<op><=|>=|==|!=|<|>)")
_DECIMALS = re.compile(r"\.(\d{1,4})\b")
_OPERATOR_TYPOS = {"=<": "<=", "=>": ">=", "=": "==", "≤": "<=", "≥": ">=", "≠": "!="}
_RELATIVE_BOUND = re.compile(r"(?P<share>.*?%)\s*of\s+(?P<reference>\w+)")
_LIKE_RELATIVE = re.compile(
    r"(?P<number>\d+(?:\.\d+)?)\s*(?P<sign>%?)\s*[x*]?\s*(?:of\s+)?(?P<reference>offered|baseline)"
)
"""What people write in its place."""

_REFERENCES = ("offered", "baseline")
COMPARISONS: Mapping[Operator, Callable[[Any, Any], bool]] = {
    "<": operator.lt,
    "<=": operator.le,
    ">": operator.gt,
    ">=": operator.ge,
    "==": operator.eq,
    "!=": operator.ne,
}


class ComparisonError(ValueError):
    """A text that is no such comparison.

    Attributes:
        column: offset into the text, counted from 0, at which the problem begins.
        suggestion: a text that would be valid there, or empty.
    """

    def __init__(self, message: str, column: int, suggestion: str = "") -> None:
        super().__init__(message)
        self.column = column
        self.suggestion = suggestion


class Bound(msgspec.Struct, frozen=True, kw_only=True):
    """The right-hand side: a value in SI base units (s, Hz, bytes, fraction, W, J, or a count)."""

    value: float
    dimension: Literal["time", "rate", "size", "share", "power", "energy", "count"]
    of_offered: bool = False
    of_baseline: bool = False


@dataclass_transform(kw_only_default=True, eq_default=False)
class Requirement:
    """A parsed requirement, equal to any other with the same text.

    Neither a struct nor a dataclass: in every document it is a string (see
    `r2bspec.language.declaration`).

    Attributes:
        text: the text as the user wrote it.
        metric: the dotted name as written: ``latency.p99``, ``detections.latency.p99``, or
            ``sustained``, which has neither operator nor bound.
        metric_column: offset of the metric into `text`.
        bound_column: offset of the bound into `text`.
    """

    kind: ClassVar[str] = "requirement"

    text: str
    metric: str
    op: Operator | None = None
    bound: Bound | None = None
    metric_column: int = 0
    bound_column: int = 0

    def __init__(self, **fields: object) -> None:
        vars(self).update(fields)

    def __eq__(self, other: object) -> bool:
        return type(other) is type(self) and other.text == self.text

    def __hash__(self) -> int:
        return hash(self.text)

    def __repr__(self) -> str:
        return f"{type(self).__name__}({self.text!r})"

    def __str__(self) -> str:
        return self.text

    @property
    def is_positive(self) -> bool:
        """Always True: the language checks it for quantities, which share this type."""
        return True

    @classmethod
    def parse(cls, text: str) -> Requirement:
        """Parse one requirement, as `parse_requirement` does."""
        return parse_requirement(text)

    @property
    def of_baseline(self) -> bool:
        """Whether its bound is relative to a baseline, so that a run alone cannot decide it."""
        return self.bound is not None and self.bound.of_baseline

    def is_met(self, value: float, limit: float) -> bool:
        """Compare a value with a limit, both in the bound's SI unit."""
        if self.op is None:
            raise ValueError(f"{self.text!r} is not a comparison")
        return COMPARISONS[self.op](value, limit)


@lru_cache(maxsize=4096)
def parse_requirement(text: str) -> Requirement:
    """Parse a requirement.

    Raises:
        ComparisonError: the text is not a requirement; with the offset of the first error.
    """
    _check_length(text)
    matched = _METRIC.match(text)
    if matched is None:
        raise ComparisonError(
            "expected a metric, such as latency.p99",
            _next_token_column(text),
            "latency.p99 < 50 ms",
        )
    metric = matched["metric"]
    metric_column = matched.start("metric")
    if metric == "sustained":
        if text[matched.end() :].strip():
            column = _next_token_column(text, matched.end())
            raise ComparisonError("unexpected text after 'sustained'", column)
        return Requirement(text=text, metric=metric, metric_column=metric_column)
    compared = _OPERATOR.match(text, matched.end())
    if compared is None:
        column = _next_token_column(text, matched.end())
        _check_decimal_percentile(text, metric, matched)
        meant = next(
            (op for other, op in _OPERATOR_TYPOS.items() if text.startswith(other, column)), "<"
        )
        raise _operator_expected(metric, column, f"{metric} {meant} ...")
    column = _next_token_column(text, compared.end())
    return Requirement(
        text=text,
        metric=metric,
        op=_operator(compared),
        bound=_parse_bound(text[column:].rstrip(), column),
        metric_column=metric_column,
        bound_column=column,
    )


def _check_decimal_percentile(text: str, metric: str, found: re.Match[str]) -> None:
    """Point out how a percentile with decimals is written.

    Raises:
        ComparisonError: the metric goes on with a decimal point, as in ``latency.p99.9``.
    """
    decimals = _DECIMALS.match(text, found.end())
    name = metric.rpartition(".")[2]
    if decimals is None or not re.fullmatch(r"p\d{1,2}", name):
        return
    meant = f"{metric}_{decimals[1]}"
    raise ComparisonError(
        f"a percentile with decimals is written with an underscore: {name}_{decimals[1]}",
        found.end() - len(name),
        meant + text[decimals.end() :],
    )


def _parse_bound(text: str, column: int) -> Bound:
    if not text:
        raise ComparisonError("missing bound", column, "50 ms")
    relative = _RELATIVE_BOUND.fullmatch(text)
    if relative is not None:
        return _relative_bound(relative, column)
    if re.fullmatch(r"[0-9]{1,15}", text):
        return Bound(value=float(text), dimension="count")
    for kind in QUANTITIES.values():
        with contextlib.suppress(QuantityError):
            return Bound(value=kind.parse(text).si, dimension=kind.dimension)
    raise _bound_error(text, column)


def _bound_error(text: str, column: int) -> ComparisonError:
    unit = re.fullmatch(r"([0-9.]+)\s*([^\s0-9.]\S*)", text)
    units = [name for kind in QUANTITIES.values() for name in kind.units]
    if unit is not None and unit[2] not in units:
        close = did_you_mean(unit[2], units)
        return ComparisonError(
            f"unknown unit {quote(unit[2])}; known units: {', '.join(units)}",
            column + unit.start(2),
            f"{unit[1]} {close}" if close else "",
        )
    if (relative := _LIKE_RELATIVE.fullmatch(text)) is not None:
        percent = float(relative["number"]) * (1 if relative["sign"] else 100)
        meant = f"{percent:.6g} % of {relative['reference']}"
        return ComparisonError(f"{quote(text)} is not a bound", column, meant)
    return ComparisonError(
        f"{quote(text)} is not a bound; write a number with a unit, such as 50 ms, 30 Hz, 2 % "
        "or 64 MiB, or an integer for a count",
        column,
    )


def _relative_bound(found: re.Match[str], column: int) -> Bound:
    try:
        share = Share.parse(found["share"])
    except QuantityError as error:
        raise ComparisonError(str(error), column, error.suggestion) from None
    reference = found["reference"]
    if reference not in _REFERENCES:
        meant = did_you_mean(reference, _REFERENCES) or "offered"
        raise ComparisonError(
            f"unknown reference {quote(reference)}; a bound is relative to 'offered' (the offered "
            "rate) or to 'baseline' (an earlier run)",
            column + found.start("reference"),
            f"{found['share']} of {meant}",
        )
    return Bound(
        value=share.fraction,
        dimension="share",
        of_offered=reference == "offered",
        of_baseline=reference == "baseline",
    )


def _check_length(text: str) -> None:
    if len(text) > MAX_REQUIREMENT_CHARACTERS:
        message = f"the requirement has more than {MAX_REQUIREMENT_CHARACTERS} characters"
        raise ComparisonError(message, 0)


def _operator(compared: re.Match[str]) -> Operator:
    return compared["op"]  # type: ignore[return-value]  # the pattern admits only operators


def _operator_expected(subject: str, column: int, example: str) -> ComparisonError:
    message = f"expected one of < <= > >= == != after {quote(subject)}"
    return ComparisonError(message, column, example)


def _next_token_column(text: str, start: int = 0) -> int:
    """Return the offset of the first character that is not white space, from `start` on."""
    return len(text) - len(text[start:].lstrip()) if text[start:].strip() else len(text)
