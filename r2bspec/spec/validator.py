"""The strict schema, applied by jsonschema."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache
from typing import TYPE_CHECKING, Any

from r2bspec.diagnostics.model import Path
from r2bspec.spec.kinds import judge
from r2bspec.spec.schema import strict_schema
from r2bspec.spec.schema.build import KIND

if TYPE_CHECKING:
    from jsonschema.exceptions import ValidationError
    from jsonschema.protocols import Validator


@cache
def schema() -> dict[str, Any]:
    """The strict schema, made once."""
    return strict_schema()


def schema_at(path: Path) -> dict[str, Any] | None:
    """The part of the strict schema that describes the value at a path, or None."""
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
    yield from _validator().iter_errors(plain)


@cache
def _validator() -> Validator:
    from jsonschema import Draft7Validator, validators
    from jsonschema.exceptions import ValidationError

    def check_kind(
        validator: Any, kind: str, instance: object, schema: dict[str, Any]
    ) -> Iterator[ValidationError]:
        del validator, kind
        problem = judge(instance, schema)
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

    # To JSON Schema 1.0 is an integer; to a ROS parameter and to YAML it is not.
    types = Draft7Validator.TYPE_CHECKER.redefine(
        "integer", lambda _, value: isinstance(value, int) and not isinstance(value, bool)
    )
    # jsonschema's own additionalProperties goes through a set: another order in each process.
    changed = {KIND: check_kind, "additionalProperties": check_other_keys}
    extend: Any = validators.extend
    made: Validator = extend(Draft7Validator, changed, type_checker=types)(schema())
    return made
