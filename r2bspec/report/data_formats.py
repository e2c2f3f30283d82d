"""Formats for programs: ``result.json``, and CSV of its values or of single messages.

In CSV times are nanoseconds of the monotonic clock, and a message that never arrived has no
`received_ns`.
"""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Final

from r2bspec.compare.report_input import ReportInput
from r2bspec.judge.judge_run import to_json
from r2bspec.judge.measure.run_samples import match_segment
from r2bspec.judge.result import Result
from r2bspec.plan.canonical_json import document_schema, schema_text
from r2bspec.plan.plan import MonitorPlan
from r2bspec.record.run_folder import Run
from r2bspec.record.run_record import Segment
from r2bspec.report.result_table import Row, result_rows

_SAMPLES_HEADER = (
    *("segment", "kind", "offered_hz", "iteration", "monitor", "step"),
    *("published_ns", "received_ns", "latency_ns"),
)


RESULT_SCHEMA: Final = "r2bspec-result-v1.schema.json"


def render_json(report_input: ReportInput) -> bytes:
    """Return the result, valid by its JSON Schema."""
    return to_json(report_input.result)


def result_schema() -> dict[str, Any]:
    """Return the JSON Schema of results, generated from the types that write them."""
    return document_schema(Result, RESULT_SCHEMA, "A result of r2bspec, version 1")


def result_schema_text() -> str:
    """Return the schema of results as a file."""
    return schema_text(result_schema())


def csv_text(header: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """Return RFC 4180 with a header line; numbers are exact, and None is empty."""
    buffer = io.StringIO()
    writer = csv.writer(buffer, lineterminator="\r\n")
    writer.writerow(header)
    writer.writerows(rows)
    return buffer.getvalue()


def render_values(report_input: ReportInput) -> bytes:
    """Return every value of a result; `iteration` is empty for pooled values."""
    result = report_input.result
    rows = ((result.run_id, result.name, *row) for row in result_rows(result))
    return csv_text(("run_id", "name", *Row._fields), rows).encode()


def render_samples(report_input: ReportInput) -> bytes:
    """Return every message, by monitor in the order of playing.

    Raises:
        SamplesMissingError: only the result is known.
    """
    run = report_input.require_run("the format samples")
    rows = (
        (
            *(answer.segment.id, answer.segment.kind, answer.segment.rate_hz, answer.segment.index),
            *(monitor.name, answer.step, answer.published_ns, answer.received_ns),
            answer.latency_ns,
        )
        for monitor in run.plan.monitors
        for answer in expected_answers(run, monitor)
    )
    return csv_text(_SAMPLES_HEADER, rows).encode()


@dataclass(frozen=True, slots=True)
class ExpectedAnswer:
    """An expected output at one monitor; `received_ns` is None if it never arrived."""

    segment: Segment
    step: int
    published_ns: int
    received_ns: int | None

    @property
    def latency_ns(self) -> int | None:
        """From publication to reception."""
        return None if self.received_ns is None else self.received_ns - self.published_ns


def expected_answers(run: Run, monitor: MonitorPlan) -> Iterator[ExpectedAnswer]:
    """Yield every expected output, as played, of the segments in which pairs are known."""
    for segment in run.record.segments:
        playback, rows, matched = match_segment(run, segment, monitor)
        if not matched.pairs_known:
            continue
        for step, row in zip(
            matched.trigger_steps.tolist(), matched.first_row.tolist(), strict=True
        ):
            yield ExpectedAnswer(
                segment=segment,
                step=step,
                published_ns=int(playback["published_ns"][step]),
                received_ns=int(rows["received_ns"][row]) if row >= 0 else None,
            )
