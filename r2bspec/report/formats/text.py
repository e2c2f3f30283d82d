"""The terminal report as plain text."""

from __future__ import annotations

from r2bspec.compare.report_input import ReportInput
from r2bspec.report.terminal import to_text


def render(report_input: ReportInput) -> bytes:
    """The terminal report without colours, 100 columns wide; wider tables are not cut."""
    text = to_text(report_input.result, whole_tables=True, verbose=report_input.verbose)
    return text.encode()
