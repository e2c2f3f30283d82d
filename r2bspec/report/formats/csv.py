"""Every value as a line of CSV, in long format for spreadsheets and data frames."""

from __future__ import annotations

import csv
import io

from r2bspec.compare.report_input import ReportInput
from r2bspec.report.result_rows import result_rows

HEADER = ("run_id", "name", "offered_hz", "iteration", "monitor", "metric", "unit", "value")


def render(report_input: ReportInput) -> bytes:
    """RFC 4180 with a header line; `iteration` is empty for pooled values."""
    result = report_input.result
    buffer = io.StringIO()
    writer = csv.writer(buffer, lineterminator="\r\n")
    writer.writerow(HEADER)
    for row in result_rows(result):
        writer.writerow(
            (
                result.run_id,
                result.name,
                "" if row.offered_hz is None else repr(row.offered_hz),
                "" if row.iteration is None else row.iteration,
                row.monitor,
                row.metric,
                row.unit,
                repr(row.value),
            )
        )
    return buffer.getvalue().encode()
