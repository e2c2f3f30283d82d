"""The percentile curve of a monitor's latency, with an axis that expands the tail."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from r2bspec.diagnostics.quote import printable
from r2bspec.judge.verdict import RequirementVerdict, Verdict
from r2bspec.measure.distribution import quantile
from r2bspec.measure.metrics import pace_of
from r2bspec.measure.samples import RunSamples, SegmentSamples, known_latencies
from r2bspec.measure.units import at_rate, show, show_rate
from r2bspec.report.html.canvas import (
    OUTCOME_COLOURS,
    Chart,
    ChartBuilder,
    colour,
    draw,
    inside_label,
    line_style,
    plain_numbers,
)
from r2bspec.report.html.svg import PALETTE

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_MAX_POINTS = 300
MIN_LOG_RATIO = 20.0
"""From this ratio of the largest latency to the median on, the latency axis is logarithmic."""


def percentile_chart(name: str, monitor: str, samples: RunSamples, verdict: Verdict) -> Chart:
    """One curve for each offered rate, with the limits and bounds of its requirements."""
    rates = sorted(samples.iterations)
    description = (
        f"Latency of {monitor} by percentile, one curve for each of "
        f"{', '.join(show_rate(rate, pace_of(samples.mode)) for rate in rates)}. The horizontal "
        "axis is logarithmic in the share of messages with a longer latency."
    )

    def paint(sketch: ChartBuilder) -> None:
        axes = sketch.figure.subplots()
        largest, median, total = 0.0, [], 2
        for number, rate in enumerate(rates):
            values, lost = _pooled(samples.iterations[rate], monitor)
            total = max(total, values.size + lost)
            if values.size:
                largest = max(largest, float(values[-1]))
                median.append(float(np.median(values)))
                label = show_rate(rate, pace_of(samples.mode))
                _curve(sketch, axes, number, label, values, lost)
        limits = [
            one
            for one in verdict.requirements
            if one.monitor == monitor and one.at_hz in rates and _is_drawn(one)
        ]
        for one in limits:
            _bar(axes, one, rates.index(one.at_hz or 0.0))
        percentile_axes(axes, total)
        if median and largest > MIN_LOG_RATIO * min(median):
            axes.set_yscale("log")
            plain_numbers(axes.yaxis)
        else:
            axes.set_ylim(bottom=0)
        for one in limits:
            _label(axes, one)
        if sketch.labels:
            sketch.figure.legend(loc="outside upper left", ncols=6)
        sketch.register_axes(axes, "percentile", "ms")

    return draw(name, f"Latency by percentile: {monitor}", description, 3.4, paint)


def _pooled(
    iterations: tuple[SegmentSamples, ...], monitor: str
) -> tuple[NDArray[np.float64], int]:
    """All latencies at a rate in ascending order, and how many messages were lost."""
    seen = [one.monitors[monitor] for one in iterations]
    values = np.sort(known_latencies(seen))
    return values, sum(one.missed for one in seen)


def _curve(
    sketch: ChartBuilder,
    axes: Axes,
    number: int,
    label: str,
    values: NDArray[np.float64],
    lost: int,
) -> None:
    """A step for each rank k of n: the value at or below which a share of k/n lies."""
    n = values.size + lost
    ranks = _ranks(values.size)
    over = np.maximum(n - ranks, 0.6)  # the largest one would be at infinity
    x = np.concatenate(([1.0], n / over))
    y = np.concatenate(([values[0]], values[ranks - 1])) * 1e3
    (line,) = axes.step(
        x, y, where="pre", color=colour(number), linestyle=line_style(number), label=label
    )
    sketch.series(line, label)
    if lost:
        axes.plot(x[-1], y[-1], marker="^", color=colour(number), markersize=8, linestyle="none")
        axes.annotate(
            f"{show(lost / n, 'share')} lost",
            (x[-1], y[-1]),
            xytext=(7, -3),
            textcoords="offset points",
            color=colour(number),
            fontsize=9,
        )


def _ranks(n: int) -> NDArray[np.int64]:
    """The ranks to draw, denser near the largest."""
    if n <= _MAX_POINTS:
        return np.arange(1, n + 1)
    from_end = np.unique(np.geomspace(1, n, _MAX_POINTS).astype(np.int64))
    return (n + 1 - from_end)[::-1]


def _is_drawn(one: RequirementVerdict) -> bool:
    """Whether it is a limit of a percentile of the latency; that of a ratio is on no axis."""
    if one.compared is not None:
        return False
    family, _, part = one.metric.rpartition(".")
    return family.endswith("latency") and quantile(part) is not None and one.limit is not None


def _place(one: RequirementVerdict) -> tuple[float, float]:
    """Where the limit is on the axes: its percentile, and the limit in ms."""
    q = quantile(one.metric.rpartition(".")[2])
    return 1 / (1 - (q or 0.0)), (one.limit or 0.0) * 1e3


def _ink(one: RequirementVerdict) -> str:
    return PALETTE[OUTCOME_COLOURS[one.outcome]]


def _bar(axes: Axes, one: RequirementVerdict, number: int) -> None:
    """The limit as a bar at its percentile, with the bounds of the estimate."""
    x, y = _place(one)
    axes.hlines(y, x / 1.6, x * 1.6, color=_ink(one), linewidth=2.4)
    if one.lower is not None and one.upper is not None and np.isfinite(one.upper):
        axes.vlines(
            x, one.lower * 1e3, one.upper * 1e3, color=colour(number), linewidth=5, alpha=0.45
        )


def _label(axes: Axes, one: RequirementVerdict) -> None:
    """The text of a limit, on the side of the bar without the curve."""
    x, y = _place(one)
    part = one.metric.rpartition(".")[2]
    above = not one.lost and one.estimate is not None and y / 1e3 > one.estimate
    text = printable(f"{part} limit {show(one.limit, one.unit)} {at_rate(one.at_hz or 0.0)}")
    inside_label(axes, x, y, text, _ink(one), above=above)


def percentile_axes(axes: Axes, total: int) -> None:
    """An axis of shares up to one of `total` messages, which expands the tail; latency in ms."""
    axes.set_xscale("log")
    axes.set_xlim(1, max(total * 1.8, 20))
    shown = {1: "0 %", 2: "50 %", 10: "90 %", 20: "95 %", 100: "99 %", 1000: "99.9 %"}
    shown |= {10_000: "99.99 %", 100_000: "99.999 %", 1_000_000: "99.9999 %"}
    ticks = {place: text for place, text in shown.items() if place <= axes.get_xlim()[1]}
    axes.set_xticks([*ticks], labels=[*ticks.values()])
    axes.set_xticks([], minor=True)
    axes.set_xlabel("share of messages at or below")
    axes.set_ylabel("latency, ms")
