"""What the substitutions and conditions of a launch file say, in both of its notations.

Python makes objects, such as ``EqualsSubstitution(side, "left")``, which are constructs here, with
their operands as texts (`launch_texts`). XML and YAML have references in texts,
``$(equals $(var side) left)``, which may be nested. Both have the same operations, and for both a
condition is true, false, or not known from the file alone: what only the machine decides stays a
reference, as in `known_functions`, and is compared with nothing.
"""

from __future__ import annotations

import ast
import re
import shlex
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

from r2bspec.interop.script_import.expressions import Expressions
from r2bspec.interop.script_import.values import ScriptLimitError, ScriptModule, StepCounter
from r2bspec.safe_io.limits import MAX_SUBSTITUTION_CHARACTERS, MAX_SUBSTITUTION_DEPTH

_WORDS: Final = {"true": True, "1": True, "false": False, "0": False}
"""What launch takes for a condition, in any case; everything else is an error there."""
OPERATIONS: Final = {
    "PythonExpression": "eval",
    "EqualsSubstitution": "equals",
    "NotEqualsSubstitution": "not-equals",
    "NotSubstitution": "not",
    "AndSubstitution": "and",
    "AllSubstitution": "and",
    "OrSubstitution": "or",
    "AnySubstitution": "or",
    "IfElseSubstitution": "if",
}
"""The operations of texts, by the names of those in Python."""
_BRACKETS: Final = re.compile(r"\$\(|[()]")


def truth_of_text(text: Any) -> bool | None:
    """Whether a text says true to launch; None if it says neither, or is not known."""
    return _WORDS.get(text.strip().lower()) if isinstance(text, str) else None


def operation_text(operation: str, operands: list[str], steps: StepCounter) -> str | None:
    """The text that an operation makes of texts; None if that is not known."""
    decided: bool | None = None
    match operation, operands:
        case "eval", [expression, *_]:
            value = _expression_value(expression, steps)
            return str(value) if isinstance(value, str | int | float) else None
        case "if", [condition, chosen, other]:
            decided = truth_of_text(condition)
            return None if decided is None else chosen if decided else other
        case (("equals" | "not-equals"), [left, right]) if "$(" not in left + right:
            decided = (left == right) is (operation == "equals")
        case "not", [operand]:
            decided = truth_of_text(operand)
            decided = None if decided is None else not decided
        case (("and" | "or"), _):
            parts = [truth_of_text(operand) for operand in operands]
            ending = operation == "or"
            decided = ending if ending in parts else None if None in parts else not ending
    return None if decided is None else str(decided).lower()


def _expression_value(text: str, steps: StepCounter) -> Any:
    """The value of an expression of constants; None or unknown for any other."""
    if len(text) > MAX_SUBSTITUTION_CHARACTERS:
        return None
    try:
        tree = ast.parse(text.strip(), mode="eval")
        module = ScriptModule(Path("expression"), text, ast.Module([], []))
        return Expressions({}, steps).value(tree.body, module.scope)
    except (SyntaxError, ValueError, RecursionError, MemoryError):
        return None


def substituted(
    text: str, values: Mapping[str, Any], steps: StepCounter, folder: str = "$(script)"
) -> str | None:
    """A text with its references replaced; None if the value of one is not known.

    Args:
        text: of a launch file in XML or YAML.
        values: the arguments and variables of the file, by name.
        steps: is charged for the length of the result.
        folder: what ``$(dirname)`` is.

    Raises:
        ScriptLimitError: it is too long, or its references are nested too deeply.
    """
    parts: list[str] = []
    outside: list[list[str]] = []
    brackets = [0]
    begin = 0
    for token in _BRACKETS.finditer(text):
        parts.append(text[begin : token.start()])
        begin = token.end()
        if token[0] == "$(":
            if len(outside) == MAX_SUBSTITUTION_DEPTH:
                raise ScriptLimitError(
                    f"references nested more than {MAX_SUBSTITUTION_DEPTH} times"
                )
            outside.append(parts)
            brackets.append(0)
            parts = []
        elif token[0] == ")" and outside and not brackets[-1]:
            inside = "".join(parts)
            value = folder if inside.strip() == "dirname" else _reference(inside, values, steps)
            if value is None:
                return None
            steps.count_text(value)
            brackets.pop()
            parts = outside.pop()
            parts.append(value)
        else:
            brackets[-1] += 1 if token[0] == "(" else -1
            parts.append(token[0])
    if outside:
        return None
    result = "".join([*parts, text[begin:]])
    steps.count_text(result)
    return result


def _reference(inside: str, values: Mapping[str, Any], steps: StepCounter) -> str | None:
    """The value of ``$(inside)``, which has no references inside any more."""
    kind, _, rest = inside.partition(" ")
    if kind == "eval":
        return operation_text("eval", [_unquoted(rest.strip())], steps)
    try:
        words = shlex.split(rest)
    except ValueError:
        return None
    match kind, words:
        case "var", [name, *default]:
            value = values.get(name, default[0] if default else None)
            return str(value) if isinstance(value, str | int | float) else None
        case "find-pkg-share", [package]:
            return f"$(share {package})"
        case "env", [name]:
            return f"$(env {name})"
    return operation_text(kind, words, steps)


def split_words(text: str) -> list[str]:
    """The words of a command line; blanks inside of references separate none."""
    words: list[str] = []
    depth = begin = 0
    for token in re.finditer(r"\$\(|[()]|\s+", text):
        if token[0].isspace():
            if not depth:
                words.append(text[begin : token.start()])
                begin = token.end()
        elif token[0] == ")":
            depth = max(0, depth - 1)
        elif depth or token[0] == "$(":
            depth += 1
    words.append(text[begin:])
    return [word for word in words if word]


def _unquoted(text: str) -> str:
    """An expression without the quotes around the whole of it."""
    if len(text) > 1 and text[0] == text[-1] in {'"', "'"} and text[0] not in text[1:-1]:
        return text[1:-1]
    return text
