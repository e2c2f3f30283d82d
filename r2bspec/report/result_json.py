"""``result.json`` and its JSON Schema, generated from the types that write it."""

from __future__ import annotations

import inspect
import json
from typing import Any

import msgspec

from r2bspec.compare.report_input import ReportInput
from r2bspec.judge.judge_run import to_json
from r2bspec.judge.result import Result


def render(report_input: ReportInput) -> bytes:
    """Return the result, valid by ``schemas/r2bspec-result-v1.schema.json``."""
    return to_json(report_input.result)


FILE_NAME = "r2bspec-result-v1.schema.json"


def result_schema() -> dict[str, Any]:
    """Return the schema as published in ``schemas/``: JSON Schema draft 2020-12."""
    (reference,), components = msgspec.json.schema_components(
        [Result], ref_template="#/$defs/{name}"
    )
    for component in components.values():
        # Python 3.13 takes the indentation off docstrings; the file must not depend on it.
        component["description"] = inspect.cleandoc(component.get("description", ""))
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "$id": FILE_NAME,
        "title": "A result of r2bspec, version 1",
        **reference,
        "$defs": components,
    }


def result_schema_text() -> str:
    """Return the schema as a file, with a newline at its end."""
    return json.dumps(result_schema(), indent=2, sort_keys=True, ensure_ascii=False) + "\n"
