"""The formats of services that keep the history of benchmarks: lists of named numbers.

Bencher Metric Format is a JSON object of benchmarks, each with its measures. A benchmark is a
monitor at a rate. Times are nanoseconds, as Bencher's own measure ``latency`` is; lower and upper
values are the smallest and the largest of the iterations.

github-action-benchmark reads a list, of which either the smaller or the bigger value is better.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator
from typing import Any, Final

from r2bspec.compare.report_input import ReportInput
from r2bspec.diagnostics.plain_text import escaped_json
from r2bspec.measure.distribution import MAIN_PERCENTILES
from r2bspec.measure.metrics import MonitorMetrics, RateMetrics
from r2bspec.measure.units import at_rate, rate_name
from r2bspec.report.report_wording import peak_text
from r2bspec.report.result_table import Measured, measured

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
