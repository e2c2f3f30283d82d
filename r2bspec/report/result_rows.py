"""Every value of a result as one row, under the names of the catalogue."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from r2bspec.judge.result import Result
from r2bspec.judge.verdict import RequirementVerdict
from r2bspec.measure.distribution import PARTS, Distribution, part_value
from r2bspec.measure.metrics import MonitorMetrics, SegmentMetrics, UseMetrics
from r2bspec.record.run_record import HarnessOverheadRecord

_COUNTS = (
    *("sent", "answered", "received", "missed", "duplicates", "reordered", "unmatched"),
    *("late", "early", "overdue", "surplus", "untimed"),
)


@dataclass(frozen=True, slots=True)
class Row:
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


def result_rows(result: Result) -> Iterator[Row]:
    """All values by rate, pooled first, then by iteration; peak, overhead and ratios last."""
    for rate in result.metrics.rates:
        for number, segment in (
            (None, rate.pooled),
            *((one.index, one) for one in rate.iterations),
        ):
            yield from _segment(segment, rate.offered_hz, number)
    search = result.metrics.search
    if search is not None and search.holds_hz is not None:
        yield Row(None, None, "", "peak.rate", "Hz", search.holds_hz)
        # Without it the peak has no upper bound.
        if search.upper_hz is not None:
            yield Row(None, None, "", "peak.below", "Hz", search.upper_hz)
    for overhead in result.harness_overhead:
        yield from _harness_overhead(overhead)
    for one in result.verdict.requirements:
        yield from _compared(one)


def _harness_overhead(overhead: HarnessOverheadRecord) -> Iterator[Row]:
    """The overhead on one input, whose topic is the monitor of these rows."""
    for part, value_ns in overhead.latencies_ns.items():
        name = f"harness_overhead.{part}"
        yield Row(overhead.rate_hz, None, overhead.topic, name, "s", value_ns / 1e9)
    counts = {"received": overhead.received, "processes": overhead.processes}
    for part, count in counts.items():
        name = f"harness_overhead.{part}"
        yield Row(overhead.rate_hz, None, overhead.topic, name, "count", float(count))


def _compared(one: RequirementVerdict) -> Iterator[Row]:
    """Base, head and ratio of a requirement of the baseline."""
    if one.compared is None:
        return
    values = {
        "base": (one.compared.unit, one.compared.base),
        "head": (one.compared.unit, one.compared.head),
        "ratio": ("share", one.estimate),
        "ratio.lower": ("share", one.lower),
        "ratio.upper": ("share", one.upper),
        "ratio.limit": ("share", one.limit),
        "ratio.n": ("count", float(one.n)),
    }
    for part, (unit, value) in values.items():
        if value is not None:
            yield Row(one.at_hz, None, one.monitor or "", f"{one.metric}.{part}", unit, value)


def _segment(segment: SegmentMetrics, rate: float, number: int | None) -> Iterator[Row]:
    def row(monitor: str, metric: str, unit: str, value: float | None) -> Iterator[Row]:
        if value is not None:
            yield Row(rate, number, monitor, metric, unit, float(value))

    for monitor, seen in segment.monitors.items():
        for metric, unit, value in _monitor(seen):
            yield from row(monitor, metric, unit, value)
    played = segment.playback
    yield from row("", "playback.rate", "Hz", played.rate_hz)
    for metric, unit, value in _distribution("playback.lateness", played.lateness):
        yield from row("", metric, unit, value)
    uses = {**segment.processes, **({"system": segment.machine} if segment.machine else {})}
    for process, use in uses.items():
        for metric, unit, value in _use(process, use):
            yield from row("", metric, unit, value)


def _monitor(seen: MonitorMetrics) -> Iterator[tuple[str, str, float | None]]:
    yield "throughput.mean", "Hz", seen.throughput_hz
    for family in ("latency", "latency_from_due", "interval", "jitter"):
        yield from _distribution(family, getattr(seen, family))
    yield "drop_rate", "share", seen.drop_rate
    for count in _COUNTS:
        yield count, "count", getattr(seen, count)


def _distribution(family: str, times: Distribution) -> Iterator[tuple[str, str, float | None]]:
    for part in PARTS:
        yield f"{family}.{part}", "s", part_value(times, part)


def _use(process: str, use: UseMetrics) -> Iterator[tuple[str, str, float | None]]:
    yield f"cpu.{process}.mean", "share", use.cpu_mean
    yield f"cpu.{process}.max", "share", use.cpu_max
    yield f"memory.{process}.max", "B", use.memory_max_bytes
    if use.faults_per_message is not None:
        yield f"minor_faults.{process}.per_message", "count", use.faults_per_message
