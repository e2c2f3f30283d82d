"""Violations of the language, explained: one diagnostic for each mistake.

One mistake may violate several rules: a missing key and an unknown key are a misspelt key. So
unknown keys are looked at first, and the keys that they mean are not missing. What remains are
values of the wrong type, form or size: a text that certainly means the same as a valid text is
replaced by it if the user asks for that; any other suggestion is an example.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from functools import cache
from typing import Final

from msgspec.structs import replace

from r2bspec.diagnostics import Diagnostic, Edit, Path, did_you_mean, format_path
from r2bspec.diagnostics.quote import clip, first_words, join_words, quote, unknown_name_help
from r2bspec.language import names
from r2bspec.language.comparison_grammar import ComparisonError, Requirement
from r2bspec.language.declaration import ValueRule, language, rule_at
from r2bspec.language.document import MAX_PROBLEMS, inner_span
from r2bspec.language.located_tree import MapNode, ScalarNode, entries_of
from r2bspec.language.quantities import Quantity, QuantityError, Rate
from r2bspec.language.structure import Violation
from r2bspec.language.yaml_document import parse_unquoted


def explain_violations(violations: Sequence[Violation]) -> list[Diagnostic]:
    """Return the diagnostics of the violations of a document."""
    diagnostics: list[Diagnostic] = []
    renamed: set[Path] = set()
    for violation in violations:
        if violation.keyword == "additionalProperties":
            for diagnostic, meant in _unknown_keys(violation):
                diagnostics.append(diagnostic)
                renamed.add((*violation.path, meant))
    for violation in violations:
        if violation.keyword == "required":
            diagnostics += _missing_keys(violation, renamed)
        elif violation.keyword != "additionalProperties" and not _is_glued(violation):
            diagnostics.append(_explain_value(violation))
    # An anchored value that is used in several places is explained once.
    unique = {(known.code, known.span): known for known in reversed(diagnostics)}
    return list(unique.values())[::-1]


# Keys: unknown with the nearest, missing, of a wrong form.


_SYNONYMS: Final = {
    "type": "format",
    "msgtype": "format",
    "source": "from",
    "rate": "at",
    "timeout": "starttimeout",
    "exec": "executable",
}
"""Words of ROS launch files and other tools, by spelling, where the map has the target key."""


def _unknown_keys(violation: Violation) -> Iterator[tuple[Diagnostic, str]]:
    """Yield a diagnostic for each unknown key, and the key of the same map that was intended."""
    owner = violation.node
    assert isinstance(owner, MapNode)  # noqa: S101 - no other value has keys
    keys = violation.rule.keys or {}
    unknown = [key for key in owner.entries if key not in keys][: MAX_PROBLEMS + 1]
    free = {_spelling(key): key for key in keys if key not in owner.entries}
    certain: dict[str, str] = {}
    for key in unknown:
        spelling = _spelling(key)
        synonym = _SYNONYMS.get(spelling, "")
        found = next((word for word in (spelling, f"{spelling}s", synonym) if word in free), "")
        if found:
            certain[key] = free.pop(found)
    for key in unknown:
        yield _unknown_key(violation, owner, key, certain.get(key, ""), free)


def _unknown_key(
    violation: Violation, owner: MapNode, key: str, meant: str, free: dict[str, str]
) -> tuple[Diagnostic, str]:
    """Return the diagnostic of an unknown key, and the key that was intended.

    Args:
        violation: the violation of the schema, at the map.
        owner: the map.
        key: the unknown key.
        meant: what it certainly means; empty if that is not known.
        free: the keys that the map lacks, by their spelling; one that is meant is taken out.
    """
    span, path = owner.entries[key].key_span, (*violation.path, key)
    if spaced := _with_space(violation, key):
        name = key.partition(":")[0]
        return violation.error("R2B014", *spaced, span=span, path=path), name
    homes = [home for home in _homes().get(key, ()) if home != format_path(violation.path)]
    if not meant and not homes:
        meant = did_you_mean(key, free.values())
        free.pop(_spelling(meant), None)
    listed = _comma_separated(violation.rule.keys or ())
    help_text = (
        f"did you mean '{meant}'? known keys: {listed}" if meant else f"known keys: {listed}"
    )
    if homes and not meant:
        places = join_words([f"'{home}'" for home in homes[:3]])
        help_text = f"it belongs under {places}; known keys here: {listed}"
    message = f"unknown key {quote(key)} {_place(violation)}"
    diagnostic = violation.error("R2B101", message, help_text, span=span, path=path)
    is_same = bool(meant) and _spelling(key) == _spelling(meant)
    return replace(diagnostic, edit=Edit(span, meant)) if is_same else diagnostic, meant


def _spelling(key: str) -> str:
    """Return the key without case and separators."""
    return key.casefold().replace("-", "").replace("_", "").replace(" ", "")


def _place(violation: Violation) -> str:
    return f"in {violation.name}" if violation.path else "at the top of the document"


@cache
def _homes() -> dict[str, tuple[str, ...]]:
    """Return the paths where each key of the language is valid, such as ``monitors.<name>``."""
    homes: dict[str, list[str]] = {}

    def walk(rule: ValueRule, path: str) -> None:
        for key, below in (rule.keys or {}).items():
            if path:
                homes.setdefault(key, []).append(path)
            walk(below, f"{path}.{key}" if path else key)
        if rule.values is not None:
            walk(rule.values, f"{path}.<name>")

    walk(language(), "")
    return {key: tuple(paths) for key, paths in homes.items()}


def _missing_keys(violation: Violation, renamed: set[Path]) -> Iterator[Diagnostic]:
    """Return one diagnostic for all keys that a map lacks."""
    keys = violation.rule.keys or {}
    present = entries_of(violation.node)
    missing = [
        key
        for key in violation.limit
        if key not in present and (*violation.path, key) not in renamed
    ]
    if missing:
        lines = [_example_line(key, keys[key]) for key in missing]
        listed = join_words([f"'{key}'" for key in missing], "and")
        noun = "key" if len(missing) == 1 else "keys"
        message = f"missing {noun} {listed} {_place(violation)}"
        help_text = f"add {join_words(lines, 'and')}"
        yield violation.error("R2B102", message, help_text, span=violation.key_span())


def _invalid_key_name(violation: Violation) -> Diagnostic:
    """Return the diagnostic of a key that is not a valid name or topic."""
    form = violation.rule.names
    assert form is not None  # noqa: S101 - only such maps have names of a form
    path, span = (*violation.path, violation.key), violation.key_span(violation.key)
    if spaced := _with_space(violation, violation.key):
        return violation.error("R2B014", *spaced, span=span, path=path)
    message = f"invalid {form.noun} {quote(violation.key)}"
    return violation.error("R2B106", message, form.message, span=span, path=path)


def _with_space(violation: Violation, key: str) -> tuple[str, str] | None:
    """Return what is wrong with a key that has its value in it, and what to write; else None."""
    owner = violation.node
    entry = owner.entries.get(key) if isinstance(owner, MapNode) else None
    name, colon, value = key.partition(":")
    if entry is None or not (name and colon and value):
        return None
    # With a space after the colon, the value would not be empty.
    is_empty = isinstance(entry.value, ScalarNode) and not entry.value.text
    return (f"missing space after '{name}:'", f"write '{name}: {value}'") if is_empty else None


def _is_glued(violation: Violation) -> bool:
    """Return True for the missing value of a key that has its value in it (see `_with_space`)."""
    name, colon, value = str(violation.path[-1] if violation.path else "").partition(":")
    return violation.value is None and bool(name and colon and value)


# Values.


def _explain_value(violation: Violation) -> Diagnostic:
    """Return the diagnostic of a value that is of the wrong type, form or size."""
    rule = violation.rule
    if rule.is_parsed or violation.keyword in {"format", "anyOf"}:
        return _invalid_quantity_or_requirement(violation)
    if violation.keyword == "pattern" and rule.words:
        return _invalid_choice(violation)
    return _EXPLANATIONS[violation.keyword](violation)


_NOT_IN_FLOW = frozenset("[]{},#&*!|>'\"%@`:")


def _wrong_type(violation: Violation) -> Diagnostic:
    """Return the diagnostic of a value of another type than the schema requires."""
    if violation.value is None:
        return _missing_value(violation)
    # A whole document that is one text may be a file of secrets: it is not quoted.
    kind = "a list" if isinstance(violation.value, list) else "a single value"
    shown = _describe_value(violation.value) if violation.path else kind
    message = f"{violation.name} must be {_describe_type(violation.rule)}, not {shown}"
    help_text, repair = _type_help(violation)
    return violation.error("R2B103", message, help_text, repair=repair)


def _missing_value(violation: Violation) -> Diagnostic:
    if not violation.path:
        return violation.error("R2B116", "the document is empty")
    shown = _example(violation.rule)
    help_text = f"set it to {_describe_type(violation.rule)}"
    if shown and len(shown) <= 60:
        help_text += f", for example {shown}"
    owner = rule_at(violation.path[:-1])
    if owner is not None and violation.path[-1] in {*(owner.keys or ())} - {*owner.required}:
        help_text += ", or leave the key out"
    node = violation.node
    if isinstance(node, ScalarNode) and node.text and violation.rule.is_text:
        help_text += f"; quote {quote(node.text)} if it is text"
    return violation.error("R2B116", f"{violation.name} has no value", help_text)


def _type_help(violation: Violation) -> tuple[str, str]:
    """Help for a wrong type, and text that can safely replace the value."""
    node, kinds = violation.node, violation.rule.kinds
    if not violation.path:
        return "a spec begins with 'r2bspec: 1' and 'name: ...'", ""
    if isinstance(node, MapNode) and violation.path[-2:-1] == ("parameters",):
        inner = next(iter(node.entries), "name")
        return f"write nested parameters with dots: '{violation.path[-1]}.{inner}: ...'", ""
    if isinstance(node, ScalarNode):
        plain = not node.style
        if "string" in kinds:
            return f'quote it: "{node.text}"', f'"{node.text}"' if plain else ""
        if "array" in kinds and plain and node.span.end_line > node.span.line:
            return "begin the line of each item with '- '", ""
        if "array" in kinds:
            text = f"[{node.text}]"
            return f"write a list: {text}", text if plain and not _NOT_IN_FLOW & {
                *text[1:-1]
            } else ""
        meant = parse_unquoted(node.text.strip().lstrip("0") or "0")
        if kinds == ("integer",) and type(meant) in {int, float} and meant == int(meant or 0):
            return f"write {int(meant)}", str(int(meant))
    return _example_help(violation), ""


def _example_help(violation: Violation) -> str:
    shown = _example(violation.rule)
    return f"for example: {shown}" if shown else ""


def _invalid_choice(violation: Violation) -> Diagnostic:
    """Return the diagnostic of a word that is not one of the choices."""
    words, value = violation.rule.words, violation.value
    meant = value.strip().casefold().replace("-", "_")
    of_key = next(
        (key for key, rule in (violation.rule.keys or {}).items() if meant in (rule.words or ())),
        "",
    )
    return violation.error(
        "R2B104",
        f"unknown choice {quote(value)} for {violation.name}",
        f"write {{{of_key}: {meant}}}"
        if of_key and meant not in words
        else unknown_name_help(value, words, "choices"),
        repair=meant if meant in words else "",
    )


def _pattern_mismatch(violation: Violation) -> Diagnostic:
    """Return the diagnostic of a text that does not match the required pattern."""
    form, value = violation.rule.pattern, violation.value
    assert form is not None  # noqa: S101 - it was not matched
    guess = value.strip()
    if form is names.MESSAGE_TYPE:
        # ROS 1 writes package/Name, Python package.msg.Name, and C++ package::msg::Name.
        guess = re.sub(r"^(\w+)/(\w+)$", r"\1/msg/\2", re.sub(r"\.|::", "/", guess))
    repair = guess if guess != value and form.matches(guess) else ""
    is_plain = isinstance(violation.node, ScalarNode) and not violation.node.style
    return violation.error(
        "R2B105",
        f"invalid {form.noun} {quote(value)}",
        f"write {repair}" if repair else form.message,
        repair=repair if is_plain else "",
    )


def _out_of_range(violation: Violation) -> Diagnostic:
    """Return the diagnostic of a number below the minimum, or above the maximum."""
    word = "least" if violation.keyword == "minimum" else "most"
    message = f"{violation.name} must be at {word} {violation.limit}, not {violation.value}"
    return violation.error("R2B107", message)


def _empty_value(violation: Violation) -> Diagnostic:
    """Return the diagnostic of an empty string, list or map that must not be empty."""
    message = f"{violation.name} must not be empty"
    return violation.error("R2B108", message, _example_help(violation))


def _too_many(violation: Violation) -> Diagnostic:
    """Return the diagnostic of a map or list with more entries than a spec can have."""
    message = f"{len(violation.value):,} entries in {violation.name}; the limit is "
    message += f"{violation.limit:,}"
    return violation.error("R2B129", message, "split the spec", span=violation.key_span())


def _unsupported_version(violation: Violation) -> Diagnostic:
    """Return the diagnostic of a version of the language that is not supported."""
    version = violation.rule.const
    return violation.error(
        "R2B115",
        f"unsupported version {violation.value} of the language; this r2bspec supports version "
        f"{version}",
        f"write 'r2bspec: {version}', or install a newer r2bspec",
    )


def _invalid_quantity_or_requirement(violation: Violation) -> Diagnostic:
    """Return the diagnostic of an invalid quantity or requirement, by its parser."""
    kind, value = violation.rule.quantity, violation.value
    assert kind is not None  # noqa: S101 - it has refused the value
    if value is None:
        return _missing_value(violation)
    is_number = isinstance(value, int | float) and not isinstance(value, bool)
    if is_number and issubclass(kind, Quantity):
        value = str(value)
    if not isinstance(value, str):
        message = f"{violation.name} must be {_describe_type(violation.rule)}, not "
        help_text = _example_help(violation)
        return violation.error("R2B103", message + _describe_value(value), help_text)
    if not issubclass(kind, Quantity):
        return _invalid_requirement(violation, value)
    try:
        kind.parse(value)
    except QuantityError as error:
        if re.fullmatch(r"\+?\d+(?:\.\d+)?", value.strip()):
            return _missing_unit(violation, value.strip(), kind)
        repair = error.suggestion if error.is_equivalent else ""
        help_text = f"write {repair}" if repair else _suggestion_help(error.suggestion)
        message = f"{violation.name}: {error}"
        return violation.error("R2B110", message, help_text, repair=repair)
    message = f"{violation.name}: the {kind.kind} must be more than zero"
    return violation.error("R2B111", message, _suggestion_help(kind.example))


def _missing_unit(violation: Violation, number: str, kind: type[Quantity]) -> Diagnostic:
    message = f"{violation.name}: {number} has no unit; {kind.units_text()}"
    text = f"{number} {next(iter(kind.units))}"
    # Only a rate has one unit that is usual: 0.02 may mean 2 %, and 2500 milliseconds.
    if kind is not Rate:
        return violation.error("R2B109", message, f"write {text} if you mean that")
    return violation.error("R2B109", message, f"write {text}", repair=text)


def _invalid_requirement(violation: Violation, text: str) -> Diagnostic:
    try:
        Requirement.parse(text)
    except ComparisonError as error:
        node, span = violation.node, None
        if isinstance(node, ScalarNode) and node.origin is None:
            source = violation.sources.get(node.span.file)
            rest = node.text[error.column :]
            length = len(rest.split()[0]) if rest.strip() and not rest[0].isspace() else 1
            span = inner_span(source, node.span, node.text, error.column, length)
        help_text = _suggestion_help(error.suggestion)
        return violation.error("R2B112", f"{violation.name}: {error}", help_text, span=span)
    raise AssertionError("a requirement was refused that can be parsed")


def _suggestion_help(text: str) -> str:
    return f"for example: {text}" if text else ""


_EXPLANATIONS: Final[Mapping[str, Callable[[Violation], Diagnostic]]] = {
    "type": _wrong_type,
    "enum": _invalid_choice,
    "const": _unsupported_version,
    "pattern": _pattern_mismatch,
    "minimum": _out_of_range,
    "maximum": _out_of_range,
    "minLength": _empty_value,
    "minItems": _empty_value,
    "minProperties": _empty_value,
    "maxItems": _too_many,
    "maxProperties": _too_many,
    "propertyNames": _invalid_key_name,
}


# Words.


_TYPES: Final = {
    "string": "a string",
    "integer": "an integer",
    "number": "a number",
    "boolean": "a boolean",
    "array": "a list",
    "object": "a map",
}


def _describe_value(value: object) -> str:
    """Describe a plain value for a message: ``the number 720``, ``a list``."""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, int | float):
        return f"the number {value}"
    if isinstance(value, str):
        return f"the string {quote(value)}"
    if isinstance(value, dict):
        return "a map"
    return "a list" if isinstance(value, list) else "null"


def _describe_type(rule: ValueRule) -> str:
    """Describe the type that a rule requires: ``a string``, ``a list``, ``a duration``."""
    if rule.is_parsed and rule.quantity is not None:
        return f"a {rule.quantity.kind}"
    return join_words([_TYPES[name] for name in rule.kinds]) or "a value"


def _comma_separated(words: Iterable[str]) -> str:
    """Return at most sixteen of the words, separated by commas."""
    return first_words([clip(word) for word in words], 16)


def _example(rule: ValueRule) -> str:
    """Return the first example of a rule as YAML on one line, or an empty string."""
    return to_flow_yaml(rule.about.examples[0]) if rule.about.examples else ""


def to_flow_yaml(value: object) -> str:
    """Return a plain value as YAML on one line."""
    import yaml

    text = yaml.safe_dump(value, default_flow_style=True, width=10**6, sort_keys=False)
    return text.removesuffix("...\n").strip()


def _example_line(key: str, rule: ValueRule) -> str:
    """Return a line to add for a missing key, with an example value if it is short enough."""
    text = _example(rule)
    return f"'{key}: {text}'" if text and len(text) <= 60 else f"'{key}'"
