"""Keys that are unknown, missing, misnamed, or stand where a name should."""

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
    """One diagnostic for each map that lacks keys, whatever their number."""
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
        yield violation.error(
            "R2B102",
            f"{violation.name} lacks {names}",
            f"add {join_words(lines, 'and')}",
            span=span_at(violation.root, violation.path, key=True),
        )


def invalid_key_name(violation: Violation) -> Diagnostic:
    """A key whose form is not that of the names or topics that belong there."""
    path = (*violation.path, violation.value)
    span = span_at(violation.root, path, key=True)
    better = repair_name(violation.value, violation.schema)
    message = violation.schema["patternErrorMessage"]
    return violation.error(
        "R2B106",
        f"{quote(violation.value)} is not a valid {violation.schema[NOUN]}",
        f"write {better}; {message}" if better else message,
        span=span,
        path=path,
    )


def missing_names(violations: Sequence[Violation]) -> Iterator[tuple[Path, Diagnostic]]:
    """Maps whose values should each stand under a name, written without the name.

    ``monitors: {topic: a, format: b}`` violates the schema twice; the mistake is one.
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
                f"'{format_path(path)}' needs a name above {comma_separated(keys)}",
                f"for example: '{format_path(path)}: {example(owner)}'",
                span=span_at(inside[0].root, path, key=True),
                path=path,
            ),
        )
