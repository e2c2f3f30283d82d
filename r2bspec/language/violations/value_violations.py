"""Values of the wrong type, form or size."""

from __future__ import annotations

from r2bspec.diagnostics import Diagnostic, did_you_mean
from r2bspec.diagnostics.quote import quote
from r2bspec.language.located_tree import ScalarNode
from r2bspec.language.schema.schema_builder import NOUN
from r2bspec.language.schema_validator import schema_at
from r2bspec.language.source_columns import inner_span
from r2bspec.language.value_kinds import check_value
from r2bspec.language.violations.schema_words import (
    comma_separated,
    describe_type,
    describe_value,
    example,
)
from r2bspec.language.violations.text_repairs import repair_text
from r2bspec.language.violations.violation import Violation
from r2bspec.language.yaml_scalars import ScalarError, resolve

_NOT_IN_FLOW = frozenset("[]{},#&*!|>'\"%@`:")


def wrong_type(violation: Violation) -> Diagnostic:
    """A value of another type than the schema requires."""
    if violation.value is None:
        return _missing_value(violation)
    # A whole document that is one text may be a file of secrets: it is not quoted.
    found = describe_value(violation.value) if violation.path else _kind_of(violation.value)
    message = f"{violation.name} must be {describe_type(violation.schema)}, not {found}"
    help_text, repair = _type_help(violation)
    return violation.error("R2B103", message, help_text, repair=repair)


def _kind_of(value: object) -> str:
    return "a list" if isinstance(value, list) else "a single value"


def _missing_value(violation: Violation) -> Diagnostic:
    if not violation.path:
        return violation.error("R2B116", "the document is empty")
    shown = example(violation.schema)
    help_text = f"set it to {describe_type(violation.schema)}"
    if shown and len(shown) <= 60:
        help_text += f", for example {shown}"
    owner = schema_at(violation.path[:-1]) or {}
    if violation.path[-1] in owner.get("properties", {}) and violation.path[-1] not in owner.get(
        "required", ()
    ):
        help_text += ", or leave the key out"
    node = violation.node
    if isinstance(node, ScalarNode) and node.text and "string" in violation.schema.get("type", ()):
        help_text += f"; quote {quote(node.text)} if it is text"
    return violation.error("R2B116", f"{violation.name} has no value", help_text)


def _type_help(violation: Violation) -> tuple[str, str]:
    """Help for a wrong type, and text that can safely replace the value."""
    value, node = violation.value, violation.node
    types = violation.schema["type"]
    types = [types] if isinstance(types, str) else types
    plain = isinstance(node, ScalarNode) and not node.style
    if isinstance(node, ScalarNode) and "string" in types:
        text = f'"{node.text}"'
        return f"quote it: {text}", text if plain else ""
    if isinstance(node, ScalarNode) and types == ["integer"]:
        help_text, repair = _integer_help(node)
        return help_text or _example_help(violation), repair
    if isinstance(node, ScalarNode) and "array" in types:
        text = f"[{node.text}]"
        simple = plain and not _NOT_IN_FLOW & set(node.text)
        return f"write a list: {text}", text if simple else ""
    if isinstance(value, list) and types == ["object"]:
        shown = example(violation.schema)
        return (f"write a map, for example {shown}" if shown else ""), ""
    if isinstance(value, dict) and violation.path[-2:-1] == ("parameters",):
        name, inner = violation.path[-1], next(iter(value), "name")
        return f"write nested parameters with dots: '{name}.{inner}: ...'", ""
    if not violation.path:
        return "a spec begins with 'r2bspec: 1' and 'name: ...'", ""
    return _example_help(violation) if {"array", "object"} & set(types) else "", ""


def _example_help(violation: Violation) -> str:
    shown = example(violation.schema)
    return f"for example: {shown}" if shown else ""


def _integer_help(node: ScalarNode) -> tuple[str, str]:
    try:
        meant = resolve(node.text.strip())
    except ScalarError:
        return "", ""
    if isinstance(meant, float) and meant.is_integer():
        return f"write {int(meant)}", str(int(meant))
    if isinstance(meant, int) and not isinstance(meant, bool):
        return f"write it without quotes: {meant}", str(meant)
    digits = node.text.strip().lstrip("0")
    if digits.isascii() and digits.isdigit():
        return f"a leading zero makes it a string; write {digits}", digits
    return "", ""


def invalid_choice(violation: Violation) -> Diagnostic:
    """A word that is not one of the choices."""
    words: list[str] = violation.limit
    if not isinstance(violation.value, str):
        message = f"{violation.name} must be one of {comma_separated(words)}"
        return violation.error("R2B103", message)
    close = did_you_mean(violation.value, words)
    known = (
        f"choices: {comma_separated(words)}" if len(words) > 1 else f"the only choice: {words[0]}"
    )
    same = close and close == violation.value.strip().casefold().replace("-", "_")
    return violation.error(
        "R2B104",
        f"unknown choice {quote(violation.value)} for {violation.name}",
        f"did you mean {close}? {known}" if close else known,
        repair=close if same else "",
    )


def unsupported_version(violation: Violation) -> Diagnostic:
    """A version of the language that this program does not support."""
    return violation.error(
        "R2B115",
        f"unsupported version {violation.value} of the language; this r2bspec supports version "
        f"{violation.limit}",
        f"write 'r2bspec: {violation.limit}', or install a newer r2bspec",
    )


def pattern_mismatch(violation: Violation) -> Diagnostic:
    """Text that does not match the required pattern."""
    better = repair_text(violation.value, violation.schema)
    node = violation.node
    message = violation.schema["patternErrorMessage"]
    return violation.error(
        "R2B105",
        f"invalid {violation.schema[NOUN]} {quote(violation.value)}",
        f"write {better}" if better else message,
        repair=better if isinstance(node, ScalarNode) and not node.style else "",
    )


def too_small(violation: Violation) -> Diagnostic:
    """A number below the minimum."""
    return violation.error(
        "R2B107",
        f"{violation.name} must be at least {violation.limit}, not {violation.value}",
    )


def too_large(violation: Violation) -> Diagnostic:
    """A number above the maximum."""
    return violation.error(
        "R2B107",
        f"{violation.name} must be at most {violation.limit}, not {violation.value}",
    )


def empty_value(violation: Violation) -> Diagnostic:
    """An empty string, list or map that must not be empty."""
    return violation.error(
        "R2B108", f"{violation.name} must not be empty", _example_help(violation)
    )


def invalid_quantity_or_requirement(violation: Violation) -> Diagnostic:
    """An invalid quantity or requirement, explained by the class that parses it."""
    if violation.value is None:
        return _missing_value(violation)
    problem = check_value(violation.value, violation.schema)
    if problem is None:
        raise AssertionError("the validator rejected a value that check_value accepts")
    if problem.code == "R2B103":
        return _not_text(violation)
    span = None
    node = violation.node
    if problem.column is not None and isinstance(node, ScalarNode) and node.origin is None:
        source = violation.sources.get(node.span.file)
        length = _token_length(node.text, problem.column)
        span = inner_span(source, node.span, node.text, problem.column, length)
    message = f"{violation.name}: {problem.message}"
    return violation.error(problem.code, message, problem.help, span=span, repair=problem.repair)


def _not_text(violation: Violation) -> Diagnostic:
    return violation.error(
        "R2B103",
        f"{violation.name} must be {describe_type(violation.schema)}, not "
        f"{describe_value(violation.value)}",
        _example_help(violation),
    )


def _token_length(text: str, column: int) -> int:
    """The length of the word that begins at a column."""
    rest = text[column:]
    return len(rest.split()[0]) if rest.split() and not rest[0].isspace() else min(len(rest), 1)
