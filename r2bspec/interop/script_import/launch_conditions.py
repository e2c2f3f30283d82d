"""Conditions of launch actions: true, false, or not known from the file alone.

Expressions are read as syntax trees; what has another form than comparisons of constants, joined
by `and`, `or` and `not`, is not known.
"""

from __future__ import annotations

import ast
from typing import Any, Final

from r2bspec.interop.script_import.plain_calls import COMPARISONS
from r2bspec.interop.script_import.script_values import Construct

_TRUE: Final = frozenset({"true", "1"})
_FALSE: Final = frozenset({"false", "0"})
"""What launch takes for a condition, in any case; everything else is an error there."""
_MAX_EXPRESSION: Final = 1000
_MAX_DEPTH: Final = 20


def condition_value(condition: Any) -> bool | None:
    """Whether the condition of an action is met; None if that is not known."""
    if condition is None or isinstance(condition, bool):
        return condition is not False
    if not isinstance(condition, Construct):
        return None
    decided = truth_of(condition.get("predicate_expression", 0))
    if decided is None or condition.short_name not in {"IfCondition", "UnlessCondition"}:
        return None
    return decided is (condition.short_name == "IfCondition")


def truth_of(value: Any, depth: int = 0) -> bool | None:
    """Whether a text, or a substitution that makes one, says true; None if that is not known."""
    if isinstance(value, Construct):
        return _substituted(value, depth) if depth < _MAX_DEPTH else None
    text = _joined(value)
    word = "" if text is None else text.strip().lower()
    return True if word in _TRUE else False if word in _FALSE else None


def expression_value(text: str) -> bool | None:
    """Whether an expression of constants is true; None for any other."""
    if len(text) > _MAX_EXPRESSION:
        return None
    try:
        return bool(_value(ast.parse(text.strip(), mode="eval").body, 0))
    except (SyntaxError, ValueError, TypeError, RecursionError, MemoryError):
        return None


def _joined(value: Any) -> str | None:
    """A text that may be written in parts."""
    if isinstance(value, bool | int):
        return str(value)
    parts = value if isinstance(value, list | tuple) else [value]
    return "".join(parts) if all(isinstance(each, str) for each in parts) else None


def _substituted(made: Construct, depth: int) -> bool | None:
    arguments = [*made.arguments, *made.keywords.values()]
    match made.short_name:
        case "PythonExpression":
            text = _joined(arguments[0]) if arguments else None
            return None if text is None else expression_value(text)
        case "EqualsSubstitution" | "NotEqualsSubstitution" if len(arguments) == 2:
            left, right = map(_joined, arguments)
            if left is None or right is None:
                return None
            return (left == right) is (made.short_name == "EqualsSubstitution")
        case "NotSubstitution" if len(arguments) == 1:
            decided = truth_of(arguments[0], depth + 1)
            return None if decided is None else not decided
        case "AndSubstitution" | "AllSubstitution":
            return all_of([truth_of(each, depth + 1) for each in arguments])
        case "OrSubstitution" | "AnySubstitution":
            return any_of([truth_of(each, depth + 1) for each in arguments])
    return None


def all_of(decided: list[bool | None]) -> bool | None:
    """Whether all are true; None if that depends on what is not known."""
    return False if False in decided else None if None in decided else True


def any_of(decided: list[bool | None]) -> bool | None:
    """Whether one is true; None if that depends on what is not known."""
    return True if True in decided else None if None in decided else False


def _value(node: ast.expr, depth: int) -> Any:
    """The value of an expression.

    Raises:
        ValueError: it is none of those that are understood.
    """
    if depth > _MAX_DEPTH:
        raise ValueError("nested too deeply")
    match node:
        case ast.Constant(value=value) if isinstance(value, str | int | float | bool):
            return value
        case ast.Tuple(elts=parts) | ast.List(elts=parts):
            return [_value(each, depth + 1) for each in parts]
        case ast.UnaryOp(op=ast.Not(), operand=operand):
            return not _value(operand, depth + 1)
        case ast.BoolOp(op=op, values=parts):
            values = [_value(each, depth + 1) for each in parts]
            return all(values) if isinstance(op, ast.And) else any(values)
        case ast.Compare(left=left, ops=ops, comparators=others):
            values = [_value(each, depth + 1) for each in (left, *others)]
            pairs = zip(ops, values[:-1], values[1:], strict=True)
            return all(COMPARISONS[type(op)](one, other) for op, one, other in pairs)
    raise ValueError("an expression of this kind is not understood")
