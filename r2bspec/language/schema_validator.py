"""Validation by the strict schema: fast for valid documents; jsonschema finds the violations."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache
from typing import TYPE_CHECKING, Any

from r2bspec.diagnostics.diagnostic import Path
from r2bspec.language.fast_validator import Predicate, compile_predicate
from r2bspec.language.schema.derive_strict import strict_schema
from r2bspec.language.schema.schema_builder import ALLOWED_WORDS, KIND, SINGLE_ITEM
from r2bspec.language.value_kinds import check_value

if TYPE_CHECKING:
    from jsonschema.exceptions import ValidationError
    from jsonschema.protocols import Validator


@cache
def schema(*, live: bool = False) -> dict[str, Any]:
    """The strict schema, built once; `live` is that of benchmarks in which nothing is played."""
    return strict_schema(live=live)


def is_valid(plain: Any) -> bool:
    """Whether the document is valid."""
    return _predicate(live=is_live(plain))(plain)


def is_live(plain: Any) -> bool:
    """Whether the document is a live benchmark, in which nothing is played."""
    playback = plain.get("playback") if isinstance(plain, dict) else None
    return isinstance(playback, dict) and playback.get("mode") == "live"


def schema_at(path: Path) -> dict[str, Any] | None:
    """The part of the strict schema for the value at a path, or None."""
    part: Any = schema()
    for step in path:
        if isinstance(step, int):
            part = part.get("items")
        else:
            part = part.get("properties", {}).get(step, part.get("additionalProperties"))
        if not isinstance(part, dict):
            return None
    found: dict[str, Any] = part
    return found


def schema_errors(plain: Any) -> Iterator[ValidationError]:
    """Every violation of the strict schema."""
    yield from _validator(live=is_live(plain)).iter_errors(plain)


@cache
def _predicate(*, live: bool) -> Predicate:
    return compile_predicate(schema(live=live))


@cache
def _validator(*, live: bool) -> Validator:
    from jsonschema import Draft7Validator, validators
    from jsonschema.exceptions import ValidationError

    def check_kind(
        validator: Any, kind: str, instance: object, schema: dict[str, Any]
    ) -> Iterator[ValidationError]:
        del validator, kind
        problem = check_value(instance, schema)
        if problem is not None:
            yield ValidationError(problem.message)

    def check_other_keys(
        validator: Any, rule: Any, instance: object, schema: dict[str, Any]
    ) -> Iterator[ValidationError]:
        if not isinstance(instance, dict):
            return
        known = schema.get("properties", {})
        others = [key for key in instance if key not in known]
        if isinstance(rule, dict):
            for key in others:
                yield from validator.descend(instance[key], rule, path=key)
        elif others:
            yield ValidationError("unknown keys")

    def check_words(
        validator: Any, words: list[str], instance: object, schema: dict[str, Any]
    ) -> Iterator[ValidationError]:
        del validator
        if KIND not in schema and isinstance(instance, str) and instance not in words:
            yield ValidationError("not a known word")

    def check_alone(
        validator: Any, alone: bool, instance: object, schema: dict[str, Any]
    ) -> Iterator[ValidationError]:
        del alone
        if isinstance(instance, str):
            yield from validator.descend(instance, schema["items"])

    # In JSON Schema, 1.0 is an integer; in ROS parameters and in YAML it is not.
    types = Draft7Validator.TYPE_CHECKER.redefine(
        "integer", lambda _, value: isinstance(value, int) and not isinstance(value, bool)
    )
    # jsonschema's own additionalProperties iterates over a set, in a random order.
    changed = {
        SINGLE_ITEM: check_alone,
        KIND: check_kind,
        ALLOWED_WORDS: check_words,
        "additionalProperties": check_other_keys,
    }
    extend: Any = validators.extend
    made: Validator = extend(Draft7Validator, changed, type_checker=types)(schema(live=live))
    return made
