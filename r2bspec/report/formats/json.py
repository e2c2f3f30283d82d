"""The content of ``result.json``."""

from __future__ import annotations

from r2bspec.compare.report_input import ReportInput
from r2bspec.judge.judge_run import to_json


def render(report_input: ReportInput) -> bytes:
    """The result, valid by ``schemas/r2bspec-result-v1.schema.json``."""
    return to_json(report_input.result)
