"""Formats of numbers for other programs: CSV, HdrHistogram, and services that keep histories.

CSV has every value of a result, or every expected output of every segment of a run. Times are
nanoseconds of the monotonic clock. A message that never arrived has no `received_ns`.

Programs that plot HdrHistogram's percentile distributions read one from each file: if a run has
several, the path of the report has placeholders, ``--report
'hdrhistogram=latency-{monitor}-{rate}.hgrm'``. Values are milliseconds and exact, because all of
them were recorded. The format cannot express lost messages; a comment at the end counts them.

Bencher Metric Format is a JSON object of benchmarks, each with its measures. A benchmark is a
monitor at a rate. Times are nanoseconds, as Bencher's own measure ``latency`` is; lower and upper
values are the smallest and the largest of the iterations. github-action-benchmark reads a list, of
which either the smaller or the bigger value is better.
"""

from __future__ import annotations

import csv
import io
import json
import math
from collections.abc import Iterable, Iterator, Sequence
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from r2bspec.compare.report_input import ReportInput
from r2bspec.diagnostics.plain_text import escaped_json
from r2bspec.judge.measure.distribution import MAIN_PERCENTILES
from r2bspec.judge.measure.metrics import MonitorMetrics, RateMetrics
from r2bspec.judge.measure.samples import known_latencies
from r2bspec.judge.measure.times import rank
from r2bspec.judge.measure.units import at_rate, rate_name
from r2bspec.report.format_registry import ReportError
from r2bspec.report.report_wording import peak_text
from r2bspec.report.result_table import Measured, Row, measured, result_rows
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
        for answer in expected_answers(run, monitor)
    )
    return csv_text(_SAMPLES_HEADER, rows).encode()


_TICKS_PER_HALF = 5
"""Lines for each halving of the distance to 100 %, as HdrHistogram's own tools write."""


def render_histogram(report_input: ReportInput) -> bytes:
    """The table with its two lines of summary.

    Raises:
        ReportError: there is not exactly one distribution, or no samples.
    """
    report_input.require_run("the format hdrhistogram")
    values, lost = _values(report_input)
    return "\n".join([*_lines(np.sort(values) * 1e3, lost), ""]).encode()


def _values(report_input: ReportInput) -> tuple[NDArray[np.float64], int | None]:
    """The latencies, and the number of lost messages; None where it is unknown."""
    samples = report_input.samples
    values = [
        (rate, monitor)
        for rate in sorted(samples.iterations if samples else ())
        for monitor in (samples.monitors if samples else ())
        if report_input.rate_hz in {None, rate} and report_input.monitor in {None, monitor}
    ]
    if samples is None or len(values) != 1:
        raise ReportError(
            f"hdrhistogram has one monitor at one rate, but this run has {len(values)} of them",
            hint="Use placeholders in the path: "
            "--report 'hdrhistogram=latency-{monitor}-{rate}.hgrm'",
        )
    ((rate, monitor),) = values
    seen = [iteration.monitors[monitor] for iteration in samples.iterations[rate]]
    lost = None if seen[0].own_pace else sum(sample.missed for sample in seen)
    return known_latencies(seen), lost


def _lines(values: NDArray[np.float64], lost: int | None) -> Iterator[str]:
    n = int(values.size)
    yield "       Value     Percentile TotalCount 1/(1-Percentile)"
    yield ""
    for share in _shares(n):
        k = rank(share, n) if share else 1
        # Equal values share one line, whose count includes all of them.
        count = int(np.searchsorted(values, values[k - 1], side="right"))
        inverse = f"{1 / (1 - share):14.2f}" if share < 1 else f"{'inf':>14}"
        yield f"{values[k - 1]:12.6f} {share:2.12f} {count:10d} {inverse}"
    mean, deviation = (float(values.mean()), float(values.std())) if n else (0.0, 0.0)
    largest = float(values[-1]) if n else 0.0
    yield f"#[Mean    = {mean:12.6f}, StdDeviation   = {deviation:12.6f}]"
    yield f"#[Max     = {largest:12.6f}, Total count    = {n:12d}]"
    if lost is not None:
        yield f"#[Lost    = {lost:12d}]"


def _shares(n: int) -> Iterator[float]:
    """0, then five steps to one half, five more to three quarters, and so on; 1 at last."""
    share = 0.0
    while n and rank(share, n) < n:
        yield share
        halvings = math.floor(math.log2(1 / (1 - share)) + 1e-9) + 1
        share += 1 / (_TICKS_PER_HALF * 2**halvings)
    if n:
        yield 1.0


_MEASURES: Final = {
    "latency": ("latency.mean", 1e9),
    **{f"latency-{part}": (f"latency.{part}", 1e9) for part in MAIN_PERCENTILES},
    "throughput": ("throughput.mean", 1.0),
    "drop-rate": ("drop_rate", 1.0),
}
"""The measures of Bencher: metric, and factor to the unit of the measure."""

_SMALLER: Final = {
    **{f"latency.{part}": ("ms", 1e3) for part in ("mean", *MAIN_PERCENTILES)},
    "drop_rate": ("%", 100.0),
}
_BIGGER: Final = {"throughput.mean": ("Hz", 1.0)}
"""The metrics of which the smaller, or the bigger, value is better: unit, and factor to it."""


def render_bencher(report_input: ReportInput) -> bytes:
    """The object, for ``bencher run --adapter json``."""
    result = report_input.result
    benchmarks: dict[str, Any] = {}
    for row in measured(result.metrics):
        rate = rate_name(row.rate.offered_hz, row.rate.pace)
        benchmarks[f"{result.name}/{row.monitor}@{rate}"] = _measures(row)
    search = result.metrics.search
    if search is not None and search.holds_hz is not None:
        peak = {"value": search.holds_hz, "lower_value": search.holds_hz}
        if search.upper_hz is not None:
            peak["upper_value"] = search.upper_hz
        benchmarks[f"{result.name}/peak"] = {"throughput": peak}
    return (json.dumps(benchmarks, indent=2) + "\n").encode()


def _measures(row: Measured) -> dict[str, Any]:
    measures: dict[str, Any] = {}
    for name, (metric, factor) in _MEASURES.items():
        value, spread = row.value(metric), row.spread(metric)
        if value is None:
            continue
        measures[name] = {"value": value * factor}
        if spread is not None:
            # Pooled percentiles may lie outside the range of the iterations.
            measures[name]["lower_value"] = min(spread.low, value) * factor
            measures[name]["upper_value"] = max(spread.high, value) * factor
    return measures


def render_smaller(report_input: ReportInput) -> bytes:
    """The list for github-action-benchmark's tool ``customSmallerIsBetter``."""
    return _to_list(
        entry
        for row in measured(report_input.result.metrics)
        for entry in _entries(report_input.result.name, row, _SMALLER)
    )


def render_bigger(report_input: ReportInput) -> bytes:
    """The list for its tool ``customBiggerIsBetter``, with the peak at its end."""
    result = report_input.result
    entries = [
        entry for row in measured(result.metrics) for entry in _entries(result.name, row, _BIGGER)
    ]
    search = result.metrics.search
    if search is not None and search.holds_hz is not None:
        peak = {"name": f"{result.name}: peak", "unit": "Hz", "value": search.holds_hz}
        entries.append(peak | {"extra": peak_text(search)})
    return _to_list(entries)


def _to_list(entries: Iterable[dict[str, Any]]) -> bytes:
    text = json.dumps([*entries], indent=2, ensure_ascii=False)
    return escaped_json(f"{text}\n".encode())


def _entries(
    name: str, row: Measured, metrics: dict[str, tuple[str, float]]
) -> Iterator[dict[str, Any]]:
    for metric, (unit, factor) in metrics.items():
        value = row.value(metric)
        if value is None:
            continue
        entry: dict[str, Any] = {
            "name": f"{name}: {row.monitor} {metric} {_at(row.rate)}",
            "unit": unit,
            "value": value * factor,
            "extra": f"{len(row.rate.iterations)} iterations, {_missed(row.seen)}",
        }
        if row.spread(metric) is not None:
            entry["range"] = row.range_text(metric)
        yield entry


def _at(rate: RateMetrics) -> str:
    """The rate in the name of a series, which must be the same in every run."""
    return f"at {rate.offered_hz:g} Hz" if rate.offered_hz else at_rate(0.0, rate.pace)


def _missed(seen: MonitorMetrics) -> str:
    if seen.sent is None:
        return f"{seen.received} received"
    return f"{seen.missed} of {seen.expected} missed"
