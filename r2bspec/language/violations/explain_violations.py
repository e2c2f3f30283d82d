"""From violations of the strict schema to diagnostics: one for each mistake.

JSON Schema reports every violated rule, and one mistake may violate several. Not reported here:
violations of a value that is unknown because a variable or an alias failed, and a missing key
whose misspelt form has been reported.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from itertools import islice
from typing import TYPE_CHECKING, Any

from r2bspec.diagnostics import Diagnostic, Path
from r2bspec.language.diagnostic_collector import MAX_PROBLEMS
from r2bspec.language.located_tree import MapNode, TreeNode, UnknownNode, lookup
from r2bspec.language.schema.schema_builder import ALLOWED_WORDS, KIND
from r2bspec.language.schema_validator import schema_errors
from r2bspec.language.source_text import Source
from r2bspec.language.violations.key_violations import invalid_key_name, missing_keys, missing_names
from r2bspec.language.violations.swapped_keys import swapped_keys
from r2bspec.language.violations.unknown_keys import unknown_keys
from r2bspec.language.violations.value_violations import (
    empty_value,
    invalid_choice,
    invalid_quantity_or_requirement,
    pattern_mismatch,
    too_large,
    too_small,
    unsupported_version,
    wrong_type,
)
from r2bspec.language.violations.violation import Violation

if TYPE_CHECKING:
    from jsonschema.exceptions import ValidationError

_MAX_ERRORS = 2 * MAX_PROBLEMS  # of jsonschema; one mistake may lead to several

_EXPLANATIONS: dict[str, Callable[[Violation], Diagnostic]] = {
    "type": wrong_type,
    "enum": invalid_choice,
    "const": unsupported_version,
    "pattern": pattern_mismatch,
    "minimum": too_small,
    "maximum": too_large,
    "minLength": empty_value,
    "minItems": empty_value,
    "minProperties": empty_value,
    "propertyNames": invalid_key_name,
    KIND: invalid_quantity_or_requirement,
    ALLOWED_WORDS: invalid_choice,
}


def explain_violations(
    root: TreeNode, plain: Any, sources: Mapping[str, Source]
) -> list[Diagnostic]:
    """Explain how a document, with the plain data `plain`, violates the strict schema."""
    errors = islice(schema_errors(plain), _MAX_ERRORS)
    all_violations = (_violation(error, root, sources) for error in errors)
    violations = [one for one in all_violations if not _unknown(one)]
    found: list[Diagnostic] = []
    unnamed = list(missing_names(violations))
    found += (diagnostic for _, diagnostic in unnamed)
    explained = {path for path, _ in unnamed}
    for paths, diagnostic in swapped_keys(violations):
        if not explained & set(paths):
            found.append(diagnostic)
            explained |= set(paths)
    violations = [one for one in violations if not _is_explained(one.path, explained)]
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
    return list(_without_duplicates(found))


def _violation(error: ValidationError, root: TreeNode, sources: Mapping[str, Source]) -> Violation:
    keyword, limit = str(error.validator), error.validator_value
    schema_path = list(error.absolute_schema_path)
    if schema_path[-2:-1] == ["propertyNames"]:
        keyword = "propertyNames"
    schema = error.schema if isinstance(error.schema, dict) else {}
    return Violation(
        tuple(error.absolute_path), keyword, limit, error.instance, schema, root, sources
    )


def _unknown(violation: Violation) -> bool:
    """Whether the violation is about a value or a key that is unknown."""
    if violation.keyword == "propertyNames":
        owner = lookup(violation.root, violation.path)
        entry = owner.entries.get(violation.value) if isinstance(owner, MapNode) else None
        return entry is not None and not entry.key_resolved
    return isinstance(violation.node, UnknownNode)


def _is_explained(path: Path, explained: set[Path]) -> bool:
    """Whether the path is at or below a path that has been explained as a whole."""
    return any(path[:length] in explained for length in range(len(path) + 1))


def _without_duplicates(found: list[Diagnostic]) -> Iterator[Diagnostic]:
    """Without repetitions due to an anchored value that is used in several places."""
    seen = set()
    for one in found:
        if (one.code, one.span) not in seen:
            seen.add((one.code, one.span))
            yield one
