"""Values of the wrong type, form or size: what is wrong with each, and what to write instead.

A text that certainly means the same as a valid one is replaced by it where the user asks for that;
any other suggestion is an example.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence

import msgspec

from r2bspec.diagnostics import Diagnostic, did_you_mean
from r2bspec.diagnostics.quote import clip, quote
from r2bspec.language import names
from r2bspec.language.declaration import NamePattern, Rule, rule_at
from r2bspec.language.located_tree import ScalarNode
from r2bspec.language.quantities import Quantity, QuantityError, Share
from r2bspec.language.read_spec import Violation
from r2bspec.language.requirement_grammar import Requirement, RequirementError
from r2bspec.language.source_text import inner_span
from r2bspec.language.yaml_scalars import ScalarError, resolve

_NOT_IN_FLOW = frozenset("[]{},#&*!|>'\"%@`:")


def wrong_type(violation: Violation) -> Diagnostic:
    """A value of another type than the schema requires."""
    if violation.value is None:
        return _missing_value(violation)
    # A whole document that is one text may be a file of secrets: it is not quoted.
    found = describe_value(violation.value) if violation.path else _kind_of(violation.value)
    message = f"{violation.name} must be {describe_type(violation.rule)}, not {found}"
    help_text, repair = _type_help(violation)
    return violation.error("R2B103", message, help_text, repair=repair)


def _kind_of(value: object) -> str:
    return "a list" if isinstance(value, list) else "a single value"


def _missing_value(violation: Violation) -> Diagnostic:
    if not violation.path:
        return violation.error("R2B116", "the document is empty")
    shown = example(violation.rule)
    help_text = f"set it to {describe_type(violation.rule)}"
    if shown and len(shown) <= 60:
        help_text += f", for example {shown}"
    owner = rule_at(violation.path[:-1])
    if owner is not None and violation.path[-1] in {*(owner.keys or ())} - {*owner.required}:
        help_text += ", or leave the key out"
    node = violation.node
    if (
        isinstance(node, ScalarNode)
        and node.text
        and "string" in violation.rule.kinds
        and not violation.rule.is_parsed
    ):
        help_text += f"; quote {quote(node.text)} if it is text"
    return violation.error("R2B116", f"{violation.name} has no value", help_text)


def _type_help(violation: Violation) -> tuple[str, str]:
    """Help for a wrong type, and text that can safely replace the value."""
    value, node = violation.value, violation.node
    types = violation.rule.kinds
    plain = isinstance(node, ScalarNode) and not node.style
    if isinstance(node, ScalarNode) and "string" in types:
        text = f'"{node.text}"'
        return f"quote it: {text}", text if plain else ""
    if isinstance(node, ScalarNode) and types == ("integer",):
        help_text, repair = _integer_help(node)
        return help_text or _example_help(violation), repair
    if isinstance(node, ScalarNode) and "array" in types:
        text = f"[{node.text}]"
        simple = plain and not _NOT_IN_FLOW & set(node.text)
        return f"write a list: {text}", text if simple else ""
    if isinstance(value, list) and types == ("object",):
        shown = example(violation.rule)
        return (f"write a map, for example {shown}" if shown else ""), ""
    if isinstance(value, dict) and violation.path[-2:-1] == ("parameters",):
        name, inner = violation.path[-1], next(iter(value), "name")
        return f"write nested parameters with dots: '{name}.{inner}: ...'", ""
    if not violation.path:
        return "a spec begins with 'r2bspec: 1' and 'name: ...'", ""
    return _example_help(violation) if {"array", "object"} & set(types) else "", ""


def _example_help(violation: Violation) -> str:
    shown = example(violation.rule)
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
    words = violation.rule.words
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
        f"{violation.rule.const}",
        f"write 'r2bspec: {violation.rule.const}', or install a newer r2bspec",
    )


def pattern_mismatch(violation: Violation) -> Diagnostic:
    """Text that does not match the required pattern."""
    form = violation.rule.pattern
    assert form is not None  # noqa: S101 - it was not matched
    better = repair_text(violation.value, form)
    node = violation.node
    return violation.error(
        "R2B105",
        f"invalid {form.noun} {quote(violation.value)}",
        f"write {better}" if better else form.message,
        repair=better if isinstance(node, ScalarNode) and not node.style else "",
    )


def too_small(violation: Violation) -> Diagnostic:
    """A number below the minimum."""
    return violation.error(
        "R2B107",
        f"{violation.name} must be at least {violation.rule.about.minimum}, not {violation.value}",
    )


def too_large(violation: Violation) -> Diagnostic:
    """A number above the maximum."""
    return violation.error(
        "R2B107",
        f"{violation.name} must be at most {violation.rule.about.maximum}, not {violation.value}",
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
    problem = check_value(violation.value, violation.rule)
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
        f"{violation.name} must be {describe_type(violation.rule)}, not "
        f"{describe_value(violation.value)}",
        _example_help(violation),
    )


def _token_length(text: str, column: int) -> int:
    """The length of the word that begins at a column."""
    rest = text[column:]
    return len(rest.split()[0]) if rest.split() and not rest[0].isspace() else min(len(rest), 1)


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


def check_value(value: object, rule: Rule) -> ValueProblem | None:
    """Why a value is not what the class of a rule parses; None if it is."""
    kind = rule.quantity
    if kind is None or value in rule.words:
        return None
    if issubclass(kind, Requirement):
        return _requirement(value)
    return _quantity(value, kind, positive=rule.about.positive)


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
    if positive and not parsed.is_positive:
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
        Requirement.parse(value)
    except RequirementError as error:
        return ValueProblem(
            "R2B112", str(error), _suggestion_help(error.suggestion), column=error.column
        )
    return None


def _suggestion_help(text: str, repair: str = "") -> str:
    if not text:
        return ""
    return f"write {text}" if text == repair else f"for example: {text}"


_TYPES = {
    "string": "a string",
    "integer": "an integer",
    "number": "a number",
    "boolean": "a boolean",
    "array": "a list",
    "object": "a map",
}


def describe_value(value: object) -> str:
    """A plain value in a message: ``the number 720``, ``a list``."""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, int | float):
        return f"the number {value}"
    if isinstance(value, str):
        return f"the string {quote(value)}"
    if isinstance(value, dict):
        return "a map"
    return "a list" if isinstance(value, list) else "null"


def describe_type(rule: Rule) -> str:
    """The type that a rule requires: ``a string``, ``a list``, ``a duration``."""
    if rule.is_parsed and rule.quantity is not None:
        return f"a {rule.quantity.kind}"
    return join_words([_TYPES[name] for name in rule.kinds])


def join_words(words: Sequence[str], joint: str = "or") -> str:
    """``a``, ``a or b``, ``a, b or c``."""
    if len(words) < 2:
        return "".join(words)
    return f"{', '.join(words[:-1])} {joint} {words[-1]}"


def comma_separated(words: Iterable[str], max_shown: int = 16) -> str:
    """The words, the first `max_shown` of them, separated by commas."""
    all_words = [clip(word) for word in words]
    more = len(all_words) - max_shown
    return ", ".join(all_words[:max_shown]) + (f" and {more} more" if more > 0 else "")


def example(rule: Rule) -> str:
    """The first example of a rule as YAML on one line, or an empty string."""
    return to_flow_yaml(rule.about.examples[0]) if rule.about.examples else ""


def to_flow_yaml(value: object) -> str:
    """A plain value as YAML on one line."""
    import yaml

    text = yaml.safe_dump(value, default_flow_style=True, width=10**6, sort_keys=False)
    return text.removesuffix("...\n").strip()


def example_line(key: str, rule: Rule) -> str:
    """A line to add for a missing key, with an example value if it is short enough."""
    text = example(rule)
    return f"'{key}: {text}'" if text and len(text) <= 60 else f"'{key}'"


def repair_text(text: str, form: NamePattern) -> str:
    """A valid text that certainly has the same meaning, or an empty string."""
    if form is names.MESSAGE_TYPE:
        guess = _message_type(text)
    elif form is names.PYTHON_NODE:
        guess = text.replace(":", ".") if ".py" not in text and "/" not in text else ""
    elif form is names.TOPIC:
        guess = _topic(text)
    else:
        guess = text.strip()
    return guess if guess != text and form.matches(guess) else ""


def repair_name(name: str, form: NamePattern) -> str:
    """A valid name close to an invalid one, or an empty string."""
    guess = repair_text(name, form) or re.sub(r"[^A-Za-z0-9_/~]+", "_", name).strip("_")
    return guess if guess != name and form.matches(guess) else ""


def _message_type(text: str) -> str:
    parts = re.split(r"[./]|::", text.strip())
    if len(parts) == 2:
        parts.insert(1, "msg")
    return "/".join(parts)


def _topic(text: str) -> str:
    return re.sub(r"/{2,}", "/", text.strip()).rstrip("/")
