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
        [Plan], schema_hook=_string_type, ref_template="#/$defs/{name}"
    )
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "$id": FILE_NAME,
        "title": "A plan of r2bspec, version 1",
        **reference,
        "$defs": components,
    }


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
