"""The JSON of github-action-benchmark: lists of metrics, smaller or bigger is better."""

from __future__ import annotations

import json
from collections.abc import Iterator
from typing import Any

from r2bspec.compare.report_input import ReportInput
from r2bspec.diagnostics.plain_text import escaped_json
from r2bspec.measure.distribution import MAIN_PERCENTILES, part_value
from r2bspec.measure.metrics import MonitorMetrics, RateMetrics
from r2bspec.measure.units import at_rate, show_range
from r2bspec.report.report_wording import peak_text

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
