"""The same benchmark on several hosts: latency by percentile, and throughput, of each host."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

from r2bspec.diagnostics.quote import printable
from r2bspec.judge.measure.distribution import PERCENTILES, part_value
from r2bspec.judge.measure.metrics import MonitorMetrics, RateMetrics
from r2bspec.judge.measure.units import show_rate
from r2bspec.judge.result import Result
from r2bspec.report.html import chart
from r2bspec.report.html.latency_charts import MIN_LOG_RATIO, percentile_axes
from r2bspec.report.suite import SuiteSummary

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_MAX_HOSTS: Final = 12
"""Hosts that one chart can show; the table of a suite has all of them."""

_MAX_RATES: Final = 4
_BAR_IN: Final = 0.2
_FRAME_IN: Final = 1.1


@dataclass(frozen=True)
class _Seen:
    """What a monitor saw on a host at one rate."""

    host: str
    rate: RateMetrics
    metrics: MonitorMetrics

    @property
    def pace(self) -> str:
        """The rate as text."""
        return show_rate(self.rate.offered_hz, self.rate.pace)


def host_charts(summary: SuiteSummary, results: Mapping[str, Result]) -> Iterator[chart.Chart]:
    """Two charts for each benchmark and monitor that has results of several hosts.

    Args:
        summary: of the suite.
        results: of its runs, by run folder.
    """
    benchmarks: dict[str, dict[str, Result]] = {}
    for run in summary.runs:
        if run.host and run.folder in results and results[run.folder].metrics.rates:
            benchmarks.setdefault(run.name, {})[run.host] = results[run.folder]
    for number, (name, by_host) in enumerate(benchmarks.items()):
        if len(by_host) > 1:
            yield from _charts(f"hosts-{number}", name, by_host)


def _charts(prefix: str, name: str, by_host: Mapping[str, Result]) -> Iterator[chart.Chart]:
    shown = dict(list(by_host.items())[:_MAX_HOSTS])
    omitted = len(by_host) - len(shown)
    monitors = dict.fromkeys(
        monitor
        for result in shown.values()
        for rate in result.metrics.rates
        for monitor in rate.pooled.monitors
    )
    for number, monitor in enumerate(monitors):
        seen = [
            _Seen(host, rate, rate.pooled.monitors[monitor])
            for host, result in shown.items()
            for rate in _shown_rates(result)
            if monitor in rate.pooled.monitors
        ]
        what = f"{name}, {monitor}" if len(monitors) > 1 else name
        note = f"{omitted} more hosts are in the table only." if omitted else ""
        yield _latency_chart(f"{prefix}-latency-{number}", what, seen, note)
        yield _throughput_chart(f"{prefix}-throughput-{number}", what, seen, note)


def _shown_rates(result: Result) -> Sequence[RateMetrics]:
    """The lowest and the highest rate, and those between them as far as there is room."""
    rates = sorted(result.metrics.rates, key=lambda each: each.offered_hz)
    if len(rates) <= _MAX_RATES:
        return rates
    last = len(rates) - 1
    return [rates[round(place * last / (_MAX_RATES - 1))] for place in range(_MAX_RATES)]


def _latency_chart(name: str, what: str, seen: Sequence[_Seen], note: str) -> chart.Chart:
    hosts, rates = _in_order(seen)
    description = (
        f"Latency by percentile of {what}, one curve for each of {', '.join(hosts)}. The "
        "horizontal axis is logarithmic in the share of messages with a longer latency; marks are "
        "the percentiles of the result."
    )

    def paint(sketch: chart.ChartBuilder) -> None:
        axes = sketch.figure.subplots()
        timed = [around for around in seen if around.metrics.latency.n]
        for sample in timed:
            _curve(
                sketch,
                axes,
                sample,
                hosts.index(sample.host),
                rates.index(sample.pace),
                len(rates) > 1,
            )
        percentile_axes(axes, max((_expected(around.metrics) for around in timed), default=2))
        medians = [around.metrics.latency.p50 or 0.0 for around in timed]
        largest = max((around.metrics.latency.max or 0.0 for around in timed), default=0.0)
        is_wide = bool(medians) and 0 < min(medians) * MIN_LOG_RATIO < largest
        chart.scale_values(axes, logarithmic=is_wide)
        if sketch.labels:
            sketch.figure.legend(loc="outside upper left", ncols=4)
        sketch.register_axes(axes, "percentile", "ms")
        lost = "A curve ends short of 100 % by the share of messages that were lost."
        is_short = any(around.metrics.missed for around in seen)
        sketch.note = f"{lost} {note}".rstrip() if is_short else note

    return chart.draw(name, f"Latency by percentile and host: {what}", description, 3.4, paint)


def _curve(
    sketch: chart.ChartBuilder, axes: Axes, one: _Seen, host: int, rate: int, has_rates: bool
) -> None:
    """A line through the minimum, the percentiles and the maximum; lost messages are beyond."""
    times = one.metrics.latency
    ranks = {"min": 1, **{part: math.ceil(q * times.n) for part, q in PERCENTILES.items()}}
    ranks["max"] = times.n
    known = [
        (_place(rank, one.metrics) if part != "min" else 1.0, value * 1e3)
        for part, rank in ranks.items()
        if (value := part_value(times, part)) is not None
    ]
    label = f"{one.host}, {one.pace}" if has_rates else one.host
    (line,) = axes.plot(
        *zip(*known, strict=True),
        color=chart.colour(host),
        # Where colours repeat or rates share one, the style tells the curves apart.
        linestyle=chart.line_style(rate if has_rates else host),
        marker=chart.marker(host),
        markersize=3,
        label=printable(label),
    )
    sketch.series(line, label)


def _expected(metrics: MonitorMetrics) -> int:
    return metrics.latency.n + (metrics.missed or 0)


def _place(rank: int, metrics: MonitorMetrics) -> float:
    """Where a rank is on the axis, as in the curve of all messages of a run."""
    total = _expected(metrics)
    return total / max(total - rank, 0.6)


def _throughput_chart(name: str, what: str, seen: Sequence[_Seen], note: str) -> chart.Chart:
    hosts, rates = _in_order(seen)
    description = (
        f"Throughput of {what}, one bar for each of {', '.join(hosts)} and rate. A vertical line "
        "across a bar is the offered rate."
    )

    def paint(sketch: chart.ChartBuilder) -> None:
        axes = sketch.figure.subplots()
        for place, sample in enumerate(seen):
            axes.barh(
                place, sample.metrics.throughput_hz, color=chart.colour(hosts.index(sample.host))
            )
            if sample.rate.offered_hz:
                ends = (place - 0.4, place + 0.4)
                axes.vlines(
                    sample.rate.offered_hz, *ends, color=chart.PALETTE["ink"], linewidth=1.6
                )
        labels = [
            f"{around.host}, {around.pace}" if len(rates) > 1 else around.host for around in seen
        ]
        axes.set_yticks(range(len(seen)), labels=[printable(label) for label in labels])
        axes.invert_yaxis()
        axes.grid(axis="y", visible=False)
        axes.set_xlim(left=0)
        axes.set_xlabel("throughput, Hz")
        sketch.note = note

    height_in = _FRAME_IN + _BAR_IN * len(seen)
    return chart.draw(name, f"Throughput by host: {what}", description, height_in, paint)


def _in_order(seen: Sequence[_Seen]) -> tuple[list[str], list[str]]:
    """Hosts, and rates as text, each once."""
    return list(dict.fromkeys(sample.host for sample in seen)), list(
        dict.fromkeys(sample.pace for sample in seen)
    )
