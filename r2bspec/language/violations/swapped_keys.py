"""Two keys of one map with each other's content."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import combinations
from typing import Any

from r2bspec.diagnostics import Diagnostic, Path, Related
from r2bspec.language.located_tree import MapNode, lookup, to_plain
from r2bspec.language.schema_validator import schema_at
from r2bspec.language.violations.violation import Violation

_MAX_OWNERS = 50
_MAX_KEYS = 20


def swapped_keys(violations: Sequence[Violation]) -> Iterator[tuple[tuple[Path, Path], Diagnostic]]:
    """The paths of two keys with each other's content, and one diagnostic for both.

    Both contents violate the schema, often many times, and neither would under the other key.
    """
    broken: dict[Path, dict[str, Violation]] = {}
    for one in violations:
        for depth, key in enumerate(one.path):
            if isinstance(key, str):
                broken.setdefault(one.path[:depth], {}).setdefault(key, one)
    for owner, keys in list(broken.items())[:_MAX_OWNERS]:
        known = (schema_at(owner) or {}).get("properties", {})
        candidates = [key for key in keys if key in known][:_MAX_KEYS]
        for first, second in combinations(candidates, 2):
            if _are_swapped(keys[first], owner, (first, second), known):
                paths = ((*owner, first), (*owner, second))
                yield paths, _diagnostic(keys[first], owner, (first, second))


def _are_swapped(
    violation: Violation, owner: Path, keys: tuple[str, str], known: dict[str, dict[str, Any]]
) -> bool:
    first, second = (lookup(violation.root, (*owner, key)) for key in keys)
    if first is None or second is None or known[keys[0]] == known[keys[1]]:
        return False
    one, other = to_plain(first), to_plain(second)
    if not (isinstance(one, dict | list) and isinstance(other, dict | list)):
        return False
    here, there = known[keys[0]], known[keys[1]]
    wrong_here = not _has_shape(one, here) and not _has_shape(other, there)
    return wrong_here and _has_shape(one, there) and _has_shape(other, here)


def _has_shape(plain: object, schema: dict[str, Any]) -> bool:
    """Whether a value has the keys and levels that a schema requires; scalars are ignored.

    Below unknown keys, references to variables are not replaced, so scalars cannot be validated.
    """
    types = schema.get("type", ())
    types = {types} if isinstance(types, str) else set(types)
    if isinstance(plain, list):
        items = schema.get("items", {})
        return "array" in types and all(_has_shape(item, items) for item in plain)
    if not isinstance(plain, dict):
        return not types or bool(types - {"array", "object"})
    known, others = schema.get("properties", {}), schema.get("additionalProperties")
    if "object" not in types or any(key not in plain for key in schema.get("required", ())):
        return False
    below = {key: known.get(key, others) for key in plain}
    return all(
        isinstance(part, dict) and _has_shape(plain[key], part) for key, part in below.items()
    )


def _diagnostic(violation: Violation, owner: Path, keys: tuple[str, str]) -> Diagnostic:
    holder = lookup(violation.root, owner)
    assert isinstance(holder, MapNode)  # noqa: S101 - both keys were found in it
    first, second = sorted(keys, key=lambda key: _order(holder, key))
    return violation.error(
        "R2B150",
        f"'{first}' and '{second}' have each other's content",
        "swap the two keys",
        span=holder.entries[first].key_span,
        path=(*owner, first),
        related=(Related("the other key", holder.entries[second].key_span),),
    )


def _order(holder: MapNode, key: str) -> tuple[int, int]:
    span = holder.entries[key].key_span
    return span.line, span.column
