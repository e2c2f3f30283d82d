"""Bencher Metric Format: a JSON object of benchmarks, each with its measures.

A benchmark is a monitor at a rate. Times are nanoseconds, as Bencher's own measure ``latency`` is;
lower and upper values are the smallest and the largest of the iterations.
"""

from __future__ import annotations

import json
from typing import Any

from r2bspec.compare.report_input import ReportInput
from r2bspec.measure.distribution import MAIN_PERCENTILES, part_value
from r2bspec.measure.metrics import RateMetrics
from r2bspec.measure.units import rate_name

_MEASURES = (
    ("latency", "latency.mean", 1e9),
    *((f"latency-{part}", f"latency.{part}", 1e9) for part in MAIN_PERCENTILES),
    ("throughput", "throughput.mean", 1.0),
    ("drop-rate", "drop_rate", 1.0),
)


def render(report_input: ReportInput) -> bytes:
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
