"""The JSON Schema of a plan, generated from its types."""

from __future__ import annotations

import json
from typing import Any

import msgspec

from r2bspec.language.quantities import Quantity
from r2bspec.language.requirement_grammar import Requirement
from r2bspec.plan.plan import Plan

FILE_NAME = "r2bspec-plan-v1.schema.json"


def plan_schema() -> dict[str, Any]:
    """The schema as published in ``schemas/``: JSON Schema draft 2020-12."""
    (reference,), components = msgspec.json.schema_components(
        [_with_quantities_required()], schema_hook=_string_type, ref_template="#/$defs/{name}"
    )
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "$id": FILE_NAME,
        "title": "A plan of r2bspec, version 1",
        **reference,
        "$defs": components,
    }


def _with_quantities_required() -> type[msgspec.Struct]:
    """`Plan`, but defaults that are quantities, which msgspec cannot write, are none."""
    fields = [
        (field.name, field.type, msgspec.NODEFAULT)
        if isinstance(field.default, Quantity)
        else (field.name, field.type, _default(field))
        for field in msgspec.structs.fields(Plan)
    ]
    namespace = {"__doc__": Plan.__doc__}
    return msgspec.defstruct(
        "Plan", fields, namespace=namespace, kw_only=True, forbid_unknown_fields=True
    )


def _default(field: msgspec.structs.FieldInfo) -> Any:
    if field.default_factory is not msgspec.NODEFAULT:
        return msgspec.field(default_factory=field.default_factory)
    return field.default


def plan_schema_text() -> str:
    """The schema as a file, with a newline at its end."""
    return json.dumps(plan_schema(), indent=2, sort_keys=True, ensure_ascii=False) + "\n"


def _string_type(kind: type) -> dict[str, Any]:
    """Values of the language that are strings in every document."""
    if issubclass(kind, Quantity):
        return {"type": "string", "title": kind.__name__, "examples": [kind.example]}
    if issubclass(kind, Requirement):
        return {"type": "string", "title": "Requirement", "examples": ["latency.p99 < 50 ms"]}
    raise NotImplementedError(f"{kind.__name__} has no schema")
