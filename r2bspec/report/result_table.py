"""The values of monitors, and every value of a result in long format.

A row of measurements has what a monitor received at a rate, over all iterations or in one of them;
its columns are the metrics of the catalogue, `METRICS`, each with its unit and its place in
``result.json``. `result_rows` has one value a row, with the values that belong to no monitor.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Final, NamedTuple

from r2bspec.judge.measure.distribution import PARTS, part_title, part_value
from r2bspec.judge.measure.metric_catalogue import WHOLE_GRAPH, observed_metric
from r2bspec.judge.measure.metrics import (
    WORK_PARTS,
    MonitorMetrics,
    RateMetrics,
    RunMetrics,
    SegmentMetrics,
    Spread,
)
from r2bspec.judge.measure.units import show_range, show_rate
from r2bspec.judge.result import Result
from r2bspec.judge.verdict import RequirementVerdict
from r2bspec.record.run_record import HarnessOverheadRecord


@dataclass(frozen=True, slots=True)
class Metric:
    """A metric of a monitor.

    Attributes:
        name: in the catalogue.
        unit: ``s``, ``Hz``, ``share`` or ``count``.
        path: its place below the monitor in ``result.json``, such as ``latency/p99``.
        title: the heading of its column.
    """

    name: str
    unit: str
    path: str
    title: str

    def value(self, seen: MonitorMetrics) -> float | None:
        """Its value; None where there is none."""
        family, _, part = self.path.partition("/")
        value = getattr(seen, family)
        if not part:
            return value  # type: ignore[no-any-return]  # a count, a rate, a share, or nothing
        return getattr(value, part) if value else None


def _metrics() -> Iterator[Metric]:
    yield Metric("throughput.mean", "Hz", "throughput_hz", "throughput")
    for family, prefix in (
        ("latency", ""),
        ("latency_from_due", "from due, "),
        ("age", "age "),
        ("interval", "interval "),
        ("jitter", "jitter "),
    ):
        for part in PARTS:
            yield Metric(f"{family}.{part}", "s", f"{family}/{part}", f"{prefix}{part_title(part)}")
    yield Metric("drop_rate", "share", "drop_rate", "drop rate")
    for count in (
        *("sent", "answered", "received", "missed", "duplicates", "reordered", "unmatched"),
        *("late", "early", "overdue", "surplus", "untimed"),
    ):
        yield Metric(count, "count", count, count)


METRICS: Final = {metric.name: metric for metric in _metrics()}
"""Every metric of a monitor that a result has, by its name, in the order of complete tables."""


@dataclass(frozen=True, slots=True)
class Measured:
    """A row of the measurements: what a monitor received at one rate.

    Attributes:
        rate: with everything that was measured at it.
        monitor: its name.
        seen: of all iterations, or of the one of `segment`.
        segment: the iteration; empty for all.
        path: of `seen` in ``result.json``, a JSON pointer without its first slash.
    """

    rate: RateMetrics
    monitor: str
    seen: MonitorMetrics
    segment: str
    path: str

    @property
    def offered(self) -> str:
        """The offered rate as text."""
        return show_rate(self.rate.offered_hz, self.rate.pace)

    def value(self, metric: str) -> float | None:
        """The value of a metric of `METRICS`; None where there is none."""
        return METRICS[metric].value(self.seen)

    def spread(self, metric: str) -> Spread | None:
        """The range of a metric over the iterations; None where it is not known."""
        return self.rate.spread[self.monitor].get(metric)

    def range_text(self, metric: str) -> str:
        """The same as text; empty where it is not known."""
        spread = self.spread(metric)
        return show_range(spread.low, spread.high, METRICS[metric].unit) if spread else ""


def monitor_names(metrics: RunMetrics) -> list[str]:
    """The monitors that have values."""
    return [*dict.fromkeys(name for rate in metrics.rates for name in rate.pooled.monitors)]


def measured(metrics: RunMetrics, monitor: str = "") -> Iterator[Measured]:
    """What each monitor, or the one of that name, received over all iterations, by rate."""
    for number, rate in enumerate(metrics.rates):
        for name, seen in rate.pooled.monitors.items():
            if monitor in {"", name}:
                path = f"metrics/rates/{number}/pooled/monitors/{pointer(name)}"
                yield Measured(rate, name, seen, "", path)


def measured_iterations(metrics: RunMetrics, monitor: str) -> Iterator[Measured]:
    """What a monitor received in each iteration, by rate."""
    for number, rate in enumerate(metrics.rates):
        for place, iteration in enumerate(rate.iterations):
            path = f"metrics/rates/{number}/iterations/{place}/monitors/{pointer(monitor)}"
            yield Measured(rate, monitor, iteration.monitors[monitor], iteration.segment, path)


def pointer(key: str) -> str:
    """A key as a part of a JSON pointer (RFC 6901)."""
    return key.replace("~", "~0").replace("/", "~1")


class Row(NamedTuple):
    """One value.

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
    """All values by rate, pooled first, then by iteration; peak, overhead and ratios last."""
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
    for overhead in result.harness_overhead:
        yield overhead.rate_hz, None, _harness_overhead(overhead)
    for requirement in result.verdict.requirements:
        yield requirement.at_hz, None, _compared(requirement)


def _segment(segment: SegmentMetrics) -> Iterator[_Value]:
    for monitor, seen in segment.monitors.items():
        for metric in METRICS.values():
            yield monitor, metric.name, metric.unit, metric.value(seen)
    yield "", "playback.rate", "Hz", segment.playback.rate_hz
    for part in PARTS:
        yield "", f"playback.lateness.{part}", "s", part_value(segment.playback.lateness, part)
    uses = {**segment.processes, WHOLE_GRAPH: segment.graph, "system": segment.machine}
    for process, use in uses.items():
        if use is None:
            continue
        yield "", f"cpu.{process}.mean", "share", use.cpu_mean
        yield "", f"cpu.{process}.max", "share", use.cpu_max
        yield "", f"memory.{process}.max", "B", use.memory_max_bytes
        yield "", f"minor_faults.{process}.per_message", "count", use.faults_per_message
        for part in WORK_PARTS if use.work is not None else ():
            yield "", f"work.{process}.{part}", "s", getattr(use.work, part)
    for series, values in (segment.anatomy or {}).items():
        observed = observed_metric(series)
        if observed is not None and observed.dimension == "share":
            yield "", series, "share", values.mean
            continue
        for part in PARTS:
            yield "", f"{series}.{part}", "s", part_value(values, part)


def _harness_overhead(overhead: HarnessOverheadRecord) -> Iterator[_Value]:
    """The overhead on one input, whose topic is the monitor of these rows."""
    for part, value_ns in overhead.latencies_ns.items():
        yield overhead.topic, f"harness_overhead.{part}", "s", value_ns / 1e9
    yield overhead.topic, "harness_overhead.received", "count", overhead.received
    yield overhead.topic, "harness_overhead.processes", "count", overhead.processes


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
