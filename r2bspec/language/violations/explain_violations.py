"""From violations of the strict schema to diagnostics: one for each mistake.

JSON Schema reports what a value violates; one mistake may violate much. What is left out here:
everything about a value that is not known, because a variable or an alias failed; and a key that
is missing where its misspelt form has been reported.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from itertools import islice
from typing import TYPE_CHECKING, Any

from r2bspec.diagnostics import Diagnostic, Path
from r2bspec.language.diagnostic_collector import MOST
from r2bspec.language.located_tree import MapNode, TreeNode, UnknownNode, lookup
from r2bspec.language.schema.schema_builder import KIND, WORDS
from r2bspec.language.schema_validator import schema_errors
from r2bspec.language.source_text import Source
from r2bspec.language.violations.key_violations import misnamed, missing_keys, name_forgotten
from r2bspec.language.violations.swapped_keys import exchanged
from r2bspec.language.violations.unknown_keys import unknown_keys
from r2bspec.language.violations.value_violations import (
    not_a_choice,
    not_of_kind,
    not_of_pattern,
    not_of_type,
    not_this_version,
    too_few,
    too_large,
    too_small,
)
from r2bspec.language.violations.violation import Violation

if TYPE_CHECKING:
    from jsonschema.exceptions import ValidationError

_MOST_ERRORS = 2 * MOST  # of jsonschema: one mistake may be several

_EXPLANATIONS: dict[str, Callable[[Violation], Diagnostic]] = {
    "type": not_of_type,
    "enum": not_a_choice,
    "const": not_this_version,
    "pattern": not_of_pattern,
    "minimum": too_small,
    "maximum": too_large,
    "minLength": too_few,
    "minItems": too_few,
    "minProperties": too_few,
    "propertyNames": misnamed,
    KIND: not_of_kind,
    WORDS: not_a_choice,
}


def explain_violations(
    root: TreeNode, plain: Any, sources: Mapping[str, Source]
) -> list[Diagnostic]:
    """Judge the document, of which `plain` is the plain data, by the strict schema, in words."""
    errors = islice(schema_errors(plain), _MOST_ERRORS)
    all_violations = (_violation(error, root, sources) for error in errors)
    violations = [one for one in all_violations if not _unknown(one)]
    found: list[Diagnostic] = []
    unnamed = list(name_forgotten(violations))
    found += (diagnostic for _, diagnostic in unnamed)
    explained = {path for path, _ in unnamed}
    for paths, diagnostic in exchanged(violations):
        if not explained & set(paths):
            found.append(diagnostic)
            explained |= set(paths)
    violations = [one for one in violations if not _below(one.path, explained)]
    renamed: set[Path] = set()
    for one in violations:
        if one.keyword == "additionalProperties":
            for diagnostic, meant in unknown_keys(one):
                found.append(diagnostic)
                renamed.add((*one.path, meant))
    found += missing_keys([one for one in violations if one.keyword == "required"], renamed)
    for one in violations:
        explanation = _EXPLANATIONS.get(one.keyword)
        if explanation is not None:
            found.append(explanation(one))
    return list(_once(found))


def _violation(error: ValidationError, root: TreeNode, sources: Mapping[str, Source]) -> Violation:
    keyword, limit = str(error.validator), error.validator_value
    way = list(error.absolute_schema_path)
    if way[-2:-1] == ["propertyNames"]:
        keyword = "propertyNames"
    schema = error.schema if isinstance(error.schema, dict) else {}
    return Violation(
        tuple(error.absolute_path), keyword, limit, error.instance, schema, root, sources
    )


def _unknown(violation: Violation) -> bool:
    """Whether the violation is about a value, or a key, whose text is not known."""
    if violation.keyword == "propertyNames":
        owner = lookup(violation.root, violation.path)
        entry = owner.entries.get(violation.value) if isinstance(owner, MapNode) else None
        return entry is not None and not entry.known
    return isinstance(violation.node, UnknownNode)


def _below(path: Path, explained: set[Path]) -> bool:
    """Whether the path leads to or into something that has been explained as a whole."""
    return any(path[:length] in explained for length in range(len(path) + 1))


def _once(found: list[Diagnostic]) -> Iterator[Diagnostic]:
    """Without the echoes of an anchored value that is used in several places."""
    seen = set()
    for one in found:
        if (one.code, one.span) not in seen:
            seen.add((one.code, one.span))
            yield one
