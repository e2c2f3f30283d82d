"""``result.json`` and its JSON Schema, generated from the types that write it."""

from __future__ import annotations

from typing import Any

from r2bspec.compare.report_input import ReportInput
from r2bspec.judge.judge_run import to_json
from r2bspec.judge.result import Result
from r2bspec.plan.canonical_json import document_schema, schema_text


def render(report_input: ReportInput) -> bytes:
    """Return the result, valid by ``schemas/r2bspec-result-v1.schema.json``."""
    return to_json(report_input.result)


FILE_NAME = "r2bspec-result-v1.schema.json"


def result_schema() -> dict[str, Any]:
    """Return the schema of results."""
    return document_schema(Result, FILE_NAME, "A result of r2bspec, version 1")


def result_schema_text() -> str:
    """Return the schema of results as a file."""
    return schema_text(result_schema())
