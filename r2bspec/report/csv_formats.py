"""CSV for spreadsheets and data frames: every value of a result, and every message of a run.

The samples are every expected output of every segment. Times are nanoseconds of the monotonic
clock. A message that never arrived has no `received_ns`.
"""

from __future__ import annotations

import csv
import io

from r2bspec.compare.report_input import ReportInput
from r2bspec.report.result_table import result_rows
from r2bspec.report.timeline import expected_answers

VALUES_HEADER = ("run_id", "name", "offered_hz", "iteration", "monitor", "metric", "unit", "value")


def render_values(report_input: ReportInput) -> bytes:
    """RFC 4180 with a header line; `iteration` is empty for pooled values."""
    result = report_input.result
    buffer = io.StringIO()
    writer = csv.writer(buffer, lineterminator="\r\n")
    writer.writerow(VALUES_HEADER)
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


SAMPLES_HEADER = (
    "segment",
    "kind",
    "offered_hz",
    "iteration",
    "monitor",
    "step",
    "published_ns",
    "received_ns",
    "latency_ns",
)


def render_samples(report_input: ReportInput) -> bytes:
    """RFC 4180 with a header line, by monitor in the order of playing.

    Raises:
        ReportError: only the result is known.
    """
    run = report_input.require_run("the format samples")
    buffer = io.StringIO()
    writer = csv.writer(buffer, lineterminator="\r\n")
    writer.writerow(SAMPLES_HEADER)
    for monitor in run.plan.monitors:
        for one in expected_answers(run, monitor.name):
            received = one.received_ns
            writer.writerow(
                (
                    one.segment.id,
                    one.segment.kind,
                    repr(one.segment.rate_hz),
                    one.segment.index,
                    monitor.name,
                    one.step,
                    one.published_ns,
                    "" if received is None else received,
                    "" if received is None else received - one.published_ns,
                )
            )
    return buffer.getvalue().encode()
