"""The values of monitors, and every value of a result in long format.

A row of measurements has the values of a monitor at a rate, over all iterations; its columns are
the declared metrics, each with its unit and its place in ``result.json``. `result_rows` has one
value a row, including values that belong to no monitor.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import NamedTuple

from r2bspec.judge.measure.distribution import PARTS, SHORT_PERCENTILES, Distribution, part_value
from r2bspec.judge.measure.metric import MetricInfo, Outputs, Section
from r2bspec.judge.measure.metric_catalogue import measured_metric, monitor_metrics
from r2bspec.judge.measure.metrics import MonitorMetrics, RateMetrics, RunMetrics, SegmentMetrics
from r2bspec.judge.measure.units import show_range, show_rate
from r2bspec.judge.result import Result
from r2bspec.judge.verdict import RequirementVerdict


def summary_metrics(outputs: Outputs = "answers") -> list[MetricInfo]:
    """Return the metrics in the table of a monitor, by the kind of its outputs."""
    return [
        info
        for info in monitor_metrics()
        if info.part in info.metric.columns and outputs in info.metric.column_of
    ]


def is_roomy(info: MetricInfo) -> bool:
    """Return True if narrow tables leave a metric out."""
    return info.quantile is not None and info.part not in SHORT_PERCENTILES


def section_metrics(section: Section) -> list[MetricInfo]:
    """Return the metrics in a table of the HTML page."""
    return [
        info
        for info in monitor_metrics()
        if info.metric.section == section
        and info.part in (info.metric.section_parts or info.metric.parts or ("",))
    ]


@dataclass(frozen=True, slots=True)
class Measured:
    """A row of the measurements: the values of a monitor at one rate.

    Attributes:
        rate: with everything that was measured at it.
        monitor: its name.
        seen: of all iterations.
        path: the path of `seen` in ``result.json``, a JSON pointer without its first slash.
    """

    rate: RateMetrics
    monitor: str
    seen: MonitorMetrics
    path: str

    @property
    def offered(self) -> str:
        """The offered rate as text."""
        return show_rate(self.rate.offered_hz, self.rate.pace)

    def range_text(self, info: MetricInfo) -> str:
        """Return the range of a metric over the iterations; empty if unknown."""
        spread = self.rate.spread[self.monitor].get(info.name)
        return show_range(spread.low, spread.high, info.unit) if spread else ""


def monitor_names(metrics: RunMetrics) -> list[str]:
    """Return the monitors that have values."""
    return [*dict.fromkeys(name for rate in metrics.rates for name in rate.pooled.monitors)]


def measured(metrics: RunMetrics, monitor: str = "") -> Iterator[Measured]:
    """Yield the values of each monitor, or of the named monitor, over all iterations, by rate."""
    for number, rate in enumerate(metrics.rates):
        for name, seen in rate.pooled.monitors.items():
            if monitor in {"", name}:
                path = f"metrics/rates/{number}/pooled/monitors/{pointer(name)}"
                yield Measured(rate, name, seen, path)


def pointer(key: str) -> str:
    """Return a key as a part of a JSON pointer (RFC 6901)."""
    return key.replace("~", "~0").replace("/", "~1")


class Row(NamedTuple):
    """A value of a result.

    Attributes:
        offered_hz: None for the whole run.
        iteration: None for all iterations pooled.
        monitor: empty if it belongs to no monitor.
        metric: its name in the catalogue.
        unit: ``s``, ``Hz``, ``B``, ``share`` or ``count``.
    """

    offered_hz: float | None
    iteration: int | None
    monitor: str
    metric: str
    unit: str
    value: float


_Value = tuple[str, str, str, float | None]
"""Monitor, metric, unit, and value."""


def result_rows(result: Result) -> Iterator[Row]:
    """Yield all values by rate, pooled first, then by iteration; peak and ratios last."""
    for offered_hz, iteration, values in _groups(result):
        for monitor, metric, unit, value in values:
            if value is not None:
                yield Row(offered_hz, iteration, monitor, metric, unit, float(value))


def _groups(result: Result) -> Iterator[tuple[float | None, int | None, Iterable[_Value]]]:
    for rate in result.metrics.rates:
        yield rate.offered_hz, None, _segment(rate.pooled)
        for iteration in rate.iterations:
            yield rate.offered_hz, iteration.index, _segment(iteration)
    search = result.metrics.search
    if search is not None and search.holds_hz is not None:
        # Without the second the peak has no upper bound.
        ends = {"peak.rate": search.holds_hz, "peak.below": search.upper_hz}
        yield None, None, [("", metric, "Hz", value) for metric, value in ends.items()]
    for requirement in result.verdict.requirements:
        yield requirement.at_hz, None, _compared(requirement)


def _segment(segment: SegmentMetrics) -> Iterator[_Value]:
    for monitor, seen in segment.monitors.items():
        for metric in monitor_metrics():
            yield monitor, metric.name, metric.unit, seen.value(metric)
    for name, value in segment.values.items():
        info = measured_metric(name)
        unit = info.unit if info is not None else ""
        if isinstance(value, Distribution):
            for part in PARTS:
                yield "", f"{name}.{part}", unit, part_value(value, part)
        else:
            yield "", name, unit, value


def _compared(requirement: RequirementVerdict) -> Iterator[_Value]:
    """Base, head and ratio of a requirement of the baseline."""
    if requirement.compared is None:
        return
    unit = requirement.compared.unit
    for part, unit_of_part, value in (
        ("base", unit, requirement.compared.base),
        ("head", unit, requirement.compared.head),
        ("ratio", "share", requirement.estimate),
        ("ratio.lower", "share", requirement.lower),
        ("ratio.upper", "share", requirement.upper),
        ("ratio.limit", "share", requirement.limit),
        ("ratio.n", "count", requirement.n),
    ):
        yield requirement.monitor or "", f"{requirement.metric}.{part}", unit_of_part, value
