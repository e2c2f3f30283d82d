"""Violations of the language, explained: one diagnostic for each mistake.

One mistake may violate several rules: a missing key and an unknown key are a misspelt key, and
several wrong values a forgotten name. These patterns are looked for first; the violations that they
explain are not reported again. What remains are values of the wrong type, form or size: a text that
certainly means the same as a valid text is replaced by it if the user asks for that; any other
suggestion is an example.
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
from r2bspec.language.declaration import NamePattern, ValueRule, language, rule_at
from r2bspec.language.document import MAX_PROBLEMS, inner_span
from r2bspec.language.located_tree import MapNode, ScalarNode, entries_of, lookup, span_at
from r2bspec.language.quantities import Quantity, QuantityError, Share
from r2bspec.language.structure import Violation
from r2bspec.language.yaml_document import ScalarError, resolve


def explain_violations(violations: Sequence[Violation]) -> list[Diagnostic]:
    """Return the diagnostics of the violations of a document."""
    diagnostics: list[Diagnostic] = []
    unnamed = list(missing_names(violations))
    diagnostics += (diagnostic for _, diagnostic in unnamed)
    explained = {path for path, _ in unnamed}
    violations = [
        candidate
        for candidate in violations
        if not _is_explained(candidate.path, explained) and not _is_glued(candidate)
    ]
    renamed: set[Path] = set()
    for violation in violations:
        if violation.keyword == "additionalProperties":
            for diagnostic, meant in unknown_keys(violation):
                diagnostics.append(diagnostic)
                renamed.add((*violation.path, meant))
    for violation in violations:
        if violation.keyword == "required":
            diagnostics += missing_keys(violation, renamed)
        elif violation.keyword != "additionalProperties":
            diagnostics.append(_explain_value(violation))
    # An anchored value that is used in several places is explained once.
    unique = {(known.code, known.span): known for known in reversed(diagnostics)}
    return list(unique.values())[::-1]


def _is_glued(violation: Violation) -> bool:
    """Return True for the missing value of a key that has its value in it (see `_with_space`)."""
    name, colon, value = str(violation.path[-1] if violation.path else "").partition(":")
    return violation.value is None and bool(name and colon and value)


def _is_explained(path: Path, explained: set[Path]) -> bool:
    """Return whether the path is at or below a path that has been explained as a whole."""
    return any(path[:length] in explained for length in range(len(path) + 1))


def missing_keys(violation: Violation, renamed: set[Path]) -> Iterator[Diagnostic]:
    """Return one diagnostic for all keys that a map lacks."""
    keys = violation.rule.keys or {}
    present = entries_of(violation.node)
    missing = [
        key
        for key in violation.limit
        if key not in present and (*violation.path, key) not in renamed
    ]
    if missing:
        lines = [example_line(key, keys[key]) for key in missing]
        names = join_words([f"'{key}'" for key in missing], "and")
        noun = "key" if len(missing) == 1 else "keys"
        yield violation.error(
            "R2B102",
            f"missing {noun} {names} {_place(violation)}",
            f"add {join_words(lines, 'and')}",
            span=violation.key_span(),
        )


def _place(violation: Violation) -> str:
    return f"in {violation.name}" if violation.path else "at the top of the document"


def invalid_key_name(violation: Violation) -> Diagnostic:
    """Return the diagnostic of a key that is not a valid name or topic."""
    form = violation.rule.names
    assert form is not None  # noqa: S101 - only such maps have names of a form
    path = (*violation.path, violation.key)
    if spaced := _with_space(violation, violation.key):
        return violation.error("R2B014", *spaced, span=violation.key_span(violation.key), path=path)
    better = repair_name(violation.key, form)
    return violation.error(
        "R2B106",
        f"invalid {form.noun} {quote(violation.key)}",
        f"write {better}; {form.message}" if better else form.message,
        span=violation.key_span(violation.key),
        path=path,
    )


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


def too_many(violation: Violation) -> Diagnostic:
    """Return the diagnostic of a map or list with more entries than a spec can have."""
    node = violation.node
    number = len(node.entries) if isinstance(node, MapNode) else len(violation.value)
    what = violation.path[-1] if isinstance(node, MapNode) else "entries"
    return violation.error(
        "R2B129",
        f"{number:,} {what}; the limit is {violation.limit:,}",
        "split the spec",
        span=violation.key_span(),
    )


def missing_names(violations: Sequence[Violation]) -> Iterator[tuple[Path, Diagnostic]]:
    """Return diagnostics of maps of named entries in which an entry lacks its name.

    ``monitors: {topic: a, format: b}`` violates the schema twice; it is one mistake.
    """
    owners: dict[Path, list[Violation]] = {}
    for violation in violations:
        if violation.keyword == "type" and violation.path and violation.rule.kinds == ("object",):
            owners.setdefault(violation.path[:-1], []).append(violation)
    for path, inside in owners.items():
        wrong = {violation.path[-1] for violation in inside}
        keys = [
            key for key in entries_of(lookup(inside[0].root, inside[0].inner[:-1])) if key in wrong
        ]
        owner = rule_at(path)
        if not any(key in (inside[0].rule.keys or {}) for key in keys):
            continue
        if owner is None or owner.names is None:
            continue
        yield (
            path,
            inside[0].error(
                "R2B117",
                f"missing name above {comma_separated(keys)} in '{format_path(path)}'",
                f"for example: '{format_path(path)}: {example(owner)}'",
                span=span_at(inside[0].root, inside[0].inner[:-1], key=True),
                path=path,
            ),
        )


_SYNONYMS = {
    "args": "arguments",
    "bags": "bag",
    "cmd": "command",
    "config": "parameters",
    "environment": "env",
    "exec": "executable",
    "message_type": "format",
    "msg_type": "format",
    "ns": "namespace",
    "params": "parameters",
    "pkg": "package",
    "rate": "at",
    "remap": "remappings",
    "extra_arg": "extra_arguments",
    "use_intra_process_comms": "intra_process",
    "requirements": "require",
    "requires": "require",
    "rosbag": "bag",
    "runs": "iterations",
    "source": "from",
    "timeout": "start_timeout",
    "type": "format",
    "vars": "variables",
}
"""Words of ROS launch files and other tools; used only where the map has the target key."""


def unknown_keys(violation: Violation) -> Iterator[tuple[Diagnostic, str]]:
    """Yield a diagnostic for each unknown key, and the key of the same map that was intended."""
    owner = violation.node
    if not isinstance(owner, MapNode):
        return
    properties = violation.rule.keys or {}
    unknown = [key for key in owner.entries if key not in properties][: MAX_PROBLEMS + 1]
    absent = {key: rule for key, rule in properties.items() if key not in owner.entries}
    meant = _intended_keys(unknown, absent)
    for key in unknown:
        if spaced := _with_space(violation, key):
            span = owner.entries[key].key_span
            name = key.partition(":")[0]
            yield (
                violation.error("R2B014", *spaced, span=span, path=(*violation.path, key)),
                name if name in absent else "",
            )
            continue
        if key in meant:
            yield _misspelled_key(violation, owner, key, meant[key]), meant[key]
            continue
        above = _missing_level(violation, owner, key)
        if above:
            help_text = f"put it under '{format_path((*violation.path, above))}'"
        else:
            help_text = _location_help(violation, key) or _present_key_help(owner, key, properties)
        yield _diagnostic(violation, owner, key, help_text), above


def _diagnostic(violation: Violation, owner: MapNode, key: str, help_text: str) -> Diagnostic:
    return violation.error(
        "R2B101",
        f"unknown key {quote(key)} {_place(violation)}",
        help_text,
        span=owner.entries[key].key_span,
        path=(*violation.path, key),
    )


def _misspelled_key(violation: Violation, owner: MapNode, key: str, meant: str) -> Diagnostic:
    known = f"known keys: {comma_separated(violation.rule.keys or ())}"
    diagnostic = _diagnostic(violation, owner, key, f"did you mean '{meant}'? {known}")
    if _spelling(key) == _spelling(meant):
        return replace(diagnostic, edit=Edit(diagnostic.span, meant))
    return diagnostic


def _intended_keys(unknown: Sequence[str], absent: Mapping[str, ValueRule]) -> dict[str, str]:
    """Return the absent key that each unknown key probably means; each is used once.

    The most certain matches come first: another spelling, one item of a list, a synonym, then a key
    that is valid elsewhere (no match here), then a similar name.
    """
    free = list(absent)
    keys_meant: dict[str, str] = {}
    for key in unknown:
        other_word = _SYNONYMS.get(key.casefold().replace("-", "_"), "")
        for name in free:
            same = {_spelling(name), _item_of(name, absent[name])}
            if _spelling(key) in same or name == other_word:
                keys_meant[key] = name
                free.remove(name)
                break
    for key in unknown:
        if key not in keys_meant and key not in _key_locations():
            close = did_you_mean(key, free)
            if close:
                keys_meant[key] = close
                free.remove(close)
    return keys_meant


def _spelling(key: str) -> str:
    """Return the key without case and separators."""
    return key.casefold().replace("-", "").replace("_", "").replace(" ", "")


def _item_of(key: str, rule: ValueRule) -> str:
    """Return the spelling of a key for one item of its list, such as 'rate' of 'rates'.

    Empty if none.
    """
    spelling = _spelling(key)
    return spelling[:-1] if rule.items is not None and spelling.endswith("s") else ""


def _missing_level(violation: Violation, owner: MapNode, key: str) -> str:
    """Return the key below which a value of this shape belongs, such as 'nodes' for a node."""
    inside = owner.entries[key].value
    if isinstance(inside, MapNode) and inside.entries:
        for name, below in (violation.rule.keys or {}).items():
            known = below.values.keys if below.values is not None else None
            if inside.entries.keys() <= (known or {}).keys():
                return name
    return ""


def _location_help(violation: Violation, key: str) -> str:
    """Help for a key that is valid elsewhere."""
    homes = [home for home in _key_locations().get(key, ()) if home != format_path(violation.path)]
    if not homes:
        return ""
    known = comma_separated(violation.rule.keys or ())
    places = join_words([f"'{home}'" for home in homes[:3]])
    return f"it belongs under {places}; known keys here: {known}"


def _present_key_help(owner: MapNode, key: str, properties: Iterable[str]) -> str:
    """Help for a key similar to one that the map already has."""
    close = did_you_mean(key, [name for name in properties if name in owner.entries])
    known = f"known keys: {comma_separated(properties)}"
    return f"did you mean '{close}', which is already set? {known}" if close else known


@cache
def _key_locations() -> dict[str, tuple[str, ...]]:
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


_NOT_IN_FLOW = frozenset("[]{},#&*!|>'\"%@`:")


def wrong_type(violation: Violation) -> Diagnostic:
    """Return the diagnostic of a value of another type than the schema requires."""
    if violation.value is None:
        return _missing_value(violation)
    # A whole document that is one text may be a file of secrets: it is not quoted.
    kind = "a list" if isinstance(violation.value, list) else "a single value"
    shown = describe_value(violation.value) if violation.path else kind
    message = f"{violation.name} must be {describe_type(violation.rule)}, not {shown}"
    help_text, repair = _type_help(violation)
    return violation.error("R2B103", message, help_text, repair=repair)


def _missing_value(violation: Violation) -> Diagnostic:
    if not violation.path:
        return violation.error("R2B116", "the document is empty")
    shown = example(violation.rule)
    help_text = f"set it to {describe_type(violation.rule)}"
    if shown and len(shown) <= 60:
        help_text += f", for example {shown}"
    owner = rule_at(violation.path[:-1])
    optional = {*(owner.keys or ())} - {*owner.required} if owner is not None else set()
    if violation.path[-1] in optional or not violation.rule.kinds:
        help_text += ", or leave it out" if not violation.rule.kinds else ", or leave the key out"
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
        if plain and node.span.end_line > node.span.line:
            return "begin the line of each item with '- '", ""
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


def pattern_mismatch(violation: Violation) -> Diagnostic:
    """Return the diagnostic of a text that does not match the required pattern."""
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


def out_of_range(violation: Violation) -> Diagnostic:
    """Return the diagnostic of a number below the minimum, or above the maximum."""
    word = "least" if violation.keyword == "minimum" else "most"
    message = f"{violation.name} must be at {word} {violation.limit}, not {violation.value}"
    return violation.error("R2B107", message)


def empty_value(violation: Violation) -> Diagnostic:
    """Return the diagnostic of an empty string, list or map that must not be empty."""
    message = f"{violation.name} must not be empty"
    return violation.error("R2B108", message, _example_help(violation))


def unsupported_version(violation: Violation) -> Diagnostic:
    """Return the diagnostic of a version of the language that is not supported."""
    version = violation.rule.const
    return violation.error(
        "R2B115",
        f"unsupported version {violation.value} of the language; this r2bspec supports version "
        f"{version}",
        f"write 'r2bspec: {version}', or install a newer r2bspec",
    )


def invalid_quantity_or_requirement(violation: Violation) -> Diagnostic:
    """Return the diagnostic of an invalid quantity or requirement, by its parser."""
    kind, value = violation.rule.quantity, violation.value
    assert kind is not None  # noqa: S101 - it has refused the value
    if value is None:
        return _missing_value(violation)
    is_number = isinstance(value, int | float) and not isinstance(value, bool)
    if is_number and issubclass(kind, Quantity):
        return _missing_unit(violation, str(value), kind)
    if not isinstance(value, str):
        message = f"{violation.name} must be {describe_type(violation.rule)}, not "
        help_text = _example_help(violation)
        return violation.error("R2B103", message + describe_value(value), help_text)
    if not issubclass(kind, Quantity):
        return _invalid_requirement(violation, value)
    try:
        kind.parse(value)
    except QuantityError as error:
        if re.fullmatch(r"[+-]?\s*\d+(?:\.\d+)?", value.strip()):
            return _missing_unit(violation, value.strip(), kind)
        repair = error.suggestion if error.is_equivalent else ""
        help_text = f"write {repair}" if repair else _suggestion_help(error.suggestion)
        message = f"{violation.name}: {error}"
        return violation.error("R2B110", message, help_text, repair=repair)
    message = f"{violation.name}: the {kind.kind} must be more than zero"
    return violation.error("R2B111", message, _suggestion_help(kind.example))


def _missing_unit(violation: Violation, number: str, kind: type[Quantity]) -> Diagnostic:
    if number.startswith("-"):
        message = f"{violation.name}: a {kind.kind} cannot be negative"
        return violation.error("R2B110", message, _suggestion_help(kind.example))
    message = f"{violation.name}: {number} has no unit; {kind.units_text()}"
    text = f"{number} {next(iter(kind.units))}"
    # 0.02 may mean 2 %, so there is no safe repair of a share.
    if kind is Share:
        return violation.error("R2B109", message, f"write {text} if you mean that")
    return violation.error("R2B109", message, f"write {text}", repair=text)


def _invalid_requirement(violation: Violation, text: str) -> Diagnostic:
    try:
        Requirement.parse(text)
    except ComparisonError as error:
        node, span = violation.node, None
        if isinstance(node, ScalarNode) and node.origin is None:
            source = violation.sources.get(node.span.file)
            length = _token_length(node.text, error.column)
            span = inner_span(source, node.span, node.text, error.column, length)
        help_text = _suggestion_help(error.suggestion)
        return violation.error("R2B112", f"{violation.name}: {error}", help_text, span=span)
    raise AssertionError("a requirement was refused that can be parsed")


def _token_length(text: str, column: int) -> int:
    """Return the length of the word that begins at a column."""
    rest = text[column:]
    return len(rest.split()[0]) if rest.split() and not rest[0].isspace() else min(len(rest), 1)


def _suggestion_help(text: str) -> str:
    return f"for example: {text}" if text else ""


_TYPES = {
    "string": "a string",
    "integer": "an integer",
    "number": "a number",
    "boolean": "a boolean",
    "array": "a list",
    "object": "a map",
}


def describe_value(value: object) -> str:
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


def describe_type(rule: ValueRule) -> str:
    """Describe the type that a rule requires: ``a string``, ``a list``, ``a duration``."""
    if rule.is_parsed and rule.quantity is not None:
        return f"a {rule.quantity.kind}"
    return join_words([_TYPES[name] for name in rule.kinds]) or "a value"


def comma_separated(words: Iterable[str]) -> str:
    """Return at most sixteen of the words, separated by commas."""
    return first_words([clip(word) for word in words], 16)


def example(rule: ValueRule) -> str:
    """Return the first example of a rule as YAML on one line, or an empty string."""
    return to_flow_yaml(rule.about.examples[0]) if rule.about.examples else ""


def to_flow_yaml(value: object) -> str:
    """Return a plain value as YAML on one line."""
    import yaml

    text = yaml.safe_dump(value, default_flow_style=True, width=10**6, sort_keys=False)
    return text.removesuffix("...\n").strip()


def example_line(key: str, rule: ValueRule) -> str:
    """Return a line to add for a missing key, with an example value if it is short enough."""
    text = example(rule)
    return f"'{key}: {text}'" if text and len(text) <= 60 else f"'{key}'"


def repair_text(text: str, form: NamePattern) -> str:
    """Return a valid text that certainly has the same meaning, or an empty string."""
    if form is names.MESSAGE_TYPE:
        guess = _message_type(text)
    elif form is names.PYTHON_NODE:
        guess = text.replace(":", ".") if ".py" not in text and "/" not in text else ""
    elif form in (names.TOPIC, names.GRAPH_TOPIC):
        guess = re.sub(r"/{2,}", "/", text.strip()).rstrip("/")
    else:
        guess = text.strip()
    return guess if guess != text and form.matches(guess) else ""


def repair_name(name: str, form: NamePattern) -> str:
    """Return a valid name close to an invalid one, or an empty string."""
    guess = repair_text(name, form) or re.sub(r"[^A-Za-z0-9_/~]+", "_", name).strip("_")
    return guess if guess != name and form.matches(guess) else ""


def _message_type(text: str) -> str:
    parts = re.split(r"[./]|::", text.strip())
    if len(parts) == 2:
        parts.insert(1, "msg")
    return "/".join(parts)


def _explain_value(violation: Violation) -> Diagnostic:
    """Return the diagnostic of a value that is of the wrong type, form or size."""
    rule = violation.rule
    if rule.is_parsed or violation.keyword in {"format", "anyOf"}:
        return invalid_quantity_or_requirement(violation)
    if violation.keyword == "pattern" and rule.words:
        return invalid_choice(violation)
    return _EXPLANATIONS[violation.keyword](violation)


_EXPLANATIONS: Final[dict[str, Callable[[Violation], Diagnostic]]] = {
    "type": wrong_type,
    "enum": invalid_choice,
    "const": unsupported_version,
    "pattern": pattern_mismatch,
    "minimum": out_of_range,
    "maximum": out_of_range,
    "minLength": empty_value,
    "minItems": empty_value,
    "minProperties": empty_value,
    "maxItems": too_many,
    "maxProperties": too_many,
    "propertyNames": invalid_key_name,
}
