"""The formats of services that keep the history of benchmarks: lists of named numbers.

Bencher Metric Format is a JSON object of benchmarks, each with its measures. A benchmark is a
monitor at a rate. Times are nanoseconds, as Bencher's own measure ``latency`` is; lower and upper
values are the smallest and the largest of the iterations.

github-action-benchmark reads a list, of which either the smaller or the bigger value is better.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from typing import Any

from r2bspec.compare.report_input import ReportInput
from r2bspec.diagnostics.plain_text import escaped_json
from r2bspec.measure.distribution import MAIN_PERCENTILES, part_value
from r2bspec.measure.metrics import MonitorMetrics, RateMetrics
from r2bspec.measure.units import at_rate, rate_name, show_range
from r2bspec.report.report_wording import peak_text

_MEASURES = (
    ("latency", "latency.mean", 1e9),
    *((f"latency-{part}", f"latency.{part}", 1e9) for part in MAIN_PERCENTILES),
    ("throughput", "throughput.mean", 1.0),
    ("drop-rate", "drop_rate", 1.0),
)


def render_bencher(report_input: ReportInput) -> bytes:
    """The object, for ``bencher run --adapter json``."""
    result = report_input.result
    found: dict[str, Any] = {}
    for rate in result.metrics.rates:
        for monitor in rate.pooled.monitors:
            found[f"{result.name}/{monitor}@{rate_name(rate.offered_hz, rate.pace)}"] = _measures(
                rate, monitor
            )
    search = result.metrics.search
    if search is not None and search.holds_hz is not None:
        peak = {"value": search.holds_hz, "lower_value": search.holds_hz}
        if search.upper_hz is not None:
            peak["upper_value"] = search.upper_hz
        found[f"{result.name}/peak"] = {"throughput": peak}
    return (json.dumps(found, indent=2) + "\n").encode()


def _measures(rate: RateMetrics, monitor: str) -> dict[str, Any]:
    seen, spread = rate.pooled.monitors[monitor], rate.spread[monitor]
    values = {
        "throughput.mean": seen.throughput_hz,
        "drop_rate": seen.drop_rate,
        **{
            f"latency.{part}": part_value(seen.latency, part)
            for part in ("mean", *MAIN_PERCENTILES)
        },
    }
    found: dict[str, Any] = {}
    for slug, metric, factor in _MEASURES:
        value = values[metric]
        if value is None:
            continue
        found[slug] = {"value": value * factor}
        if metric in spread:
            # Pooled percentiles may lie outside the range of the iterations.
            found[slug]["lower_value"] = min(spread[metric].low, value) * factor
            found[slug]["upper_value"] = max(spread[metric].high, value) * factor
    return found


_SMALLER = (
    *((f"latency.{part}", "s", 1e3, "ms") for part in ("mean", *MAIN_PERCENTILES)),
    ("drop_rate", "share", 100.0, "%"),
)
_BIGGER = (("throughput.mean", "Hz", 1.0, "Hz"),)


def to_json(report_input: ReportInput, *, bigger: bool) -> bytes:
    """The list for ``customBiggerIsBetter`` or for ``customSmallerIsBetter``."""
    result = report_input.result
    entries = [
        entry
        for rate in result.metrics.rates
        for monitor in rate.pooled.monitors
        for entry in _entries(result.name, rate, monitor, bigger=bigger)
    ]
    search = result.metrics.search
    if bigger and search is not None and search.holds_hz is not None:
        found = {"name": f"{result.name}: peak", "unit": "Hz", "value": search.holds_hz}
        entries.append(found | {"extra": peak_text(search)})
    return escaped_json((json.dumps(entries, indent=2, ensure_ascii=False) + "\n").encode())


def _entries(
    name: str, rate: RateMetrics, monitor: str, *, bigger: bool
) -> Iterator[dict[str, Any]]:
    seen, spread = rate.pooled.monitors[monitor], rate.spread[monitor]
    for metric, unit, factor, shown in _BIGGER if bigger else _SMALLER:
        family, _, part = metric.partition(".")
        value = {"throughput": seen.throughput_hz, "drop_rate": seen.drop_rate}.get(family)
        value = part_value(seen.latency, part) if family == "latency" else value
        if value is None:
            continue
        entry: dict[str, Any] = {
            "name": f"{name}: {monitor} {metric} {_at(rate)}",
            "unit": shown,
            "value": value * factor,
            "extra": f"{len(rate.iterations)} iterations, {_missed(seen)}",
        }
        if metric in spread:
            entry["range"] = show_range(spread[metric].low, spread[metric].high, unit)
        yield entry


def _at(rate: RateMetrics) -> str:
    """The rate in the name of a series, which must be the same in every run."""
    return f"at {rate.offered_hz:g} Hz" if rate.offered_hz else at_rate(0.0, rate.pace)


def _missed(seen: MonitorMetrics) -> str:
    if seen.sent is None:
        return f"{seen.received} received"
    return f"{seen.missed} of {seen.expected} missed"


def render_bigger(report_input: ReportInput) -> bytes:
    """The list; see `r2bspec.report.benchmark_services`."""
    return to_json(report_input, bigger=True)


def render_smaller(report_input: ReportInput) -> bytes:
    """The list; see `r2bspec.report.benchmark_services`."""
    return to_json(report_input, bigger=False)
