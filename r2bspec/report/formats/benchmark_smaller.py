"""Input of github-action-benchmark's tool ``customSmallerIsBetter``."""

from __future__ import annotations

from r2bspec.compare.report_input import ReportInput
from r2bspec.report.action_benchmark import to_json


def render(report_input: ReportInput) -> bytes:
    """The list; see `r2bspec.report.action_benchmark`."""
    return to_json(report_input, bigger=False)
