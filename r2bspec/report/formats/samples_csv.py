"""Every expected output of every segment as a line of CSV: the raw samples of a run.

Times are nanoseconds of the monotonic clock. A message that never arrived has no `received_ns`.
"""

from __future__ import annotations

import csv
import io

from r2bspec.compare.report_input import ReportInput
from r2bspec.report.trace_timeline import expected_answers

HEADER = (
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


def render(report_input: ReportInput) -> bytes:
    """RFC 4180 with a header line, by monitor in the order of playing.

    Raises:
        ReportError: only the result is known.
    """
    run = report_input.require_run("the format samples")
    buffer = io.StringIO()
    writer = csv.writer(buffer, lineterminator="\r\n")
    writer.writerow(HEADER)
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
