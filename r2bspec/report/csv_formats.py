"""CSV for spreadsheets and data frames: every value of a result, and every message of a run.

The samples are every expected output of every segment. Times are nanoseconds of the monotonic
clock. A message that never arrived has no `received_ns`.
"""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Sequence

from r2bspec.compare.report_input import ReportInput
from r2bspec.report.result_table import Row, result_rows
from r2bspec.report.timeline import expected_answers

_SAMPLES_HEADER = (
    *("segment", "kind", "offered_hz", "iteration", "monitor", "step"),
    *("published_ns", "received_ns", "latency_ns"),
)


def csv_text(header: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """RFC 4180 with a header line; numbers are exact, and None is empty."""
    buffer = io.StringIO()
    writer = csv.writer(buffer, lineterminator="\r\n")
    writer.writerow(header)
    writer.writerows(rows)
    return buffer.getvalue()


def render_values(report_input: ReportInput) -> bytes:
    """Every value of a result; `iteration` is empty for pooled values."""
    result = report_input.result
    rows = ((result.run_id, result.name, *row) for row in result_rows(result))
    return csv_text(("run_id", "name", *Row._fields), rows).encode()


def render_samples(report_input: ReportInput) -> bytes:
    """Every message, by monitor in the order of playing.

    Raises:
        ReportError: only the result is known.
    """
    run = report_input.require_run("the format samples")
    rows = (
        (
            *(answer.segment.id, answer.segment.kind, answer.segment.rate_hz, answer.segment.index),
            *(monitor.name, answer.step, answer.published_ns, answer.received_ns),
            answer.latency_ns,
        )
        for monitor in run.plan.monitors
        for answer in expected_answers(run, monitor.name)
    )
    return csv_text(_SAMPLES_HEADER, rows).encode()
