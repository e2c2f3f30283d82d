"""Load and overhead: lateness of the playback, CPU and memory, and harness overhead."""

from __future__ import annotations

from rich.console import Group, RenderableType

from r2bspec.measure.distribution import TAIL_PERCENTILE, part_title, part_value
from r2bspec.measure.metrics import RateMetrics, RunMetrics, UseMetrics
from r2bspec.measure.units import show, show_rate, significant
from r2bspec.record.run_record import HarnessOverheadRecord
from r2bspec.report.harness_wording import overhead_placement
from r2bspec.report.terminal.style import heading, table

_MEMORY_WIDTH = 9
_FAULTS_WIDTH = 9
_RATE_WIDTH = 17
"""Columns with their gaps, at their widest: ``1,023 MiB``, ``12,345`` and ``251 µs (348 µs)``."""

_PLAYED_LABEL = "playback rate"
_LATE_LABEL = f"lateness {part_title(TAIL_PERCENTILE)} (max)"


def load_section(metrics: RunMetrics, width: int) -> RenderableType | None:
    """A line for each process and a column for each rate; None without rates."""
    rates = metrics.rates
    if not rates:
        return None
    # Many rates are split into several tables.
    names = [name for rate in rates for name in rate.pooled.processes]
    name_width = max(map(len, (*names, _LATE_LABEL))) + 2
    across = max(1, (width - name_width - _MEMORY_WIDTH - _FAULTS_WIDTH) // _RATE_WIDTH)
    return Group(
        heading("load", "CPU mean (max); 100 % is one core; minor page faults a message"),
        *(_table(rates[start : start + across]) for start in range(0, len(rates), across)),
    )


def harness_overhead_section(
    harness_overhead: tuple[HarnessOverheadRecord, ...],
) -> RenderableType | None:
    """The latency of harness and transport without the graph; None if not measured."""
    if not harness_overhead:
        return None
    made = table(["input", "size", "at", "p50", "p99", "received"])
    for each in harness_overhead:
        made.add_row(
            each.topic,
            show(float(each.bytes), "B"),
            show_rate(each.rate_hz, "recording"),
            *(_ns(value) for value in (each.latency_p50_ns, each.latency_p99_ns)),
            f"{each.received} of {each.sent}",
        )
    where = overhead_placement(harness_overhead)
    what = f"latency without the graph{where and ', '}{where}; included in the latencies above"
    return Group(heading("harness overhead", what), made)


def _ns(value: int | None) -> str:
    return "-" if value is None else show(value / 1e9, "s")


def _table(rates: tuple[RateMetrics, ...]) -> RenderableType:
    columns = ["process", *(show_rate(rate.offered_hz, rate.pace) for rate in rates), "memory"]
    made = table([*columns, "faults"])
    names = dict.fromkeys(name for rate in rates for name in rate.pooled.processes)
    for name in names:
        uses = [rate.pooled.processes.get(name) for rate in rates]
        made.add_row(name, *map(_cpu, uses), _memory(uses), _faults(uses))
    machine = [rate.pooled.machine for rate in rates]
    if any(machine):
        made.add_row("whole machine", *map(_cpu, machine), _memory(machine), "")
    if any(rate.pooled.playback.sent is not None for rate in rates):
        made.add_row(
            _PLAYED_LABEL, *(show(rate.pooled.playback.rate_hz, "Hz") for rate in rates), "", ""
        )
        made.add_row(_LATE_LABEL, *map(_lateness, rates), "", "")
    return made


def _cpu(use: UseMetrics | None) -> str:
    if use is None or use.cpu_mean is None or use.cpu_max is None:
        return "-"
    return f"{_percent(use.cpu_mean)} ({_percent(use.cpu_max)}) %"


def _percent(share: float) -> str:
    """Whole percents from 10 on: processor time has no finer resolution."""
    return significant(share * 100, 2) if share < 0.1 else f"{share * 100:.0f}"


def _memory(uses: list[UseMetrics | None]) -> str:
    known = [
        use.memory_max_bytes for use in uses if use is not None and use.memory_max_bytes is not None
    ]
    return show(float(max(known)), "B") if known else "-"


def _faults(uses: list[UseMetrics | None]) -> str:
    known = [
        use.faults_per_message
        for use in uses
        if use is not None and use.faults_per_message is not None
    ]
    return significant(max(known), 2) if known else "-"


def _lateness(rate: RateMetrics) -> str:
    late = rate.pooled.playback.lateness
    return f"{show(part_value(late, TAIL_PERCENTILE), 's')} ({show(late.max, 's')})"
