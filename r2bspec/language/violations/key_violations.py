"""Missing keys, invalid names of keys, and keys in the place of a name."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence

from r2bspec.diagnostics import Diagnostic, Path, format_path
from r2bspec.diagnostics.quote import quote
from r2bspec.language.located_tree import span_at
from r2bspec.language.schema.schema_builder import NOUN
from r2bspec.language.schema_validator import schema_at
from r2bspec.language.violations.schema_words import (
    comma_separated,
    example,
    example_line,
    join_words,
)
from r2bspec.language.violations.text_repairs import repair_name
from r2bspec.language.violations.violation import Violation


def missing_keys(violations: Iterable[Violation], renamed: set[Path]) -> Iterator[Diagnostic]:
    """One diagnostic for each map with missing keys, whatever their number."""
    seen: set[Path] = set()
    for violation in violations:
        if violation.path in seen:
            continue
        seen.add(violation.path)
        missing = [
            key
            for key in violation.limit
            if key not in violation.value and (*violation.path, key) not in renamed
        ]
        if not missing:
            continue
        properties = violation.schema["properties"]
        lines = [example_line(key, properties[key]) for key in missing]
        names = join_words([f"'{key}'" for key in missing], "and")
        noun = "key" if len(missing) == 1 else "keys"
        place = f"in {violation.name}" if violation.path else "at the top of the document"
        yield violation.error(
            "R2B102",
            f"missing {noun} {names} {place}",
            f"add {join_words(lines, 'and')}",
            span=span_at(violation.root, violation.path, key=True),
        )


def invalid_key_name(violation: Violation) -> Diagnostic:
    """A key that is not a valid name or topic."""
    path = (*violation.path, violation.value)
    span = span_at(violation.root, path, key=True)
    better = repair_name(violation.value, violation.schema)
    message = violation.schema["patternErrorMessage"]
    return violation.error(
        "R2B106",
        f"invalid {violation.schema[NOUN]} {quote(violation.value)}",
        f"write {better}; {message}" if better else message,
        span=span,
        path=path,
    )


def missing_names(violations: Sequence[Violation]) -> Iterator[tuple[Path, Diagnostic]]:
    """Maps of named entries in which an entry is written without its name.

    ``monitors: {topic: a, format: b}`` violates the schema twice; it is one mistake.
    """
    owners: dict[Path, list[Violation]] = {}
    for violation in violations:
        if violation.keyword == "type" and violation.path and violation.limit == "object":
            owners.setdefault(violation.path[:-1], []).append(violation)
    for path, inside in owners.items():
        keys = [str(one.path[-1]) for one in inside]
        properties = inside[0].schema.get("properties", {})
        if not properties or not any(key in properties for key in keys):
            continue
        owner = schema_at(path)
        if owner is None or "propertyNames" not in owner:
            continue
        yield (
            path,
            inside[0].error(
                "R2B117",
                f"missing name above {comma_separated(keys)} in '{format_path(path)}'",
                f"for example: '{format_path(path)}: {example(owner)}'",
                span=span_at(inside[0].root, path, key=True),
                path=path,
            ),
        )
