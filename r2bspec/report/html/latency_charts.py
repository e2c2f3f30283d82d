"""Charts of the latency: by percentile, and by message.

The percentile curve has an axis that expands the tail. The messages are in the order of playing,
with misses marked.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from r2bspec.diagnostics.quote import printable
from r2bspec.judge.measure.distribution import quantile
from r2bspec.judge.measure.metrics import pace_of
from r2bspec.judge.measure.sample_table import MonitorSamples
from r2bspec.judge.measure.samples import RunSamples, SegmentSamples, known_latencies
from r2bspec.judge.measure.units import at_rate, show, show_rate
from r2bspec.judge.verdict import RequirementVerdict, Verdict
from r2bspec.report.document import Chart
from r2bspec.report.html import chart

if TYPE_CHECKING:
    from matplotlib.axes import Axes


StepLatencies = NDArray[np.float64]
"""Seconds, one for each expected output, in order; NaN for missed ones."""


def step_latencies(seen: MonitorSamples) -> StepLatencies:
    """Return the latencies of the expected outputs of one segment at one monitor.

    None if unknown.
    """
    latencies = seen.latency
    if seen.unknown_latency or (seen.own_pace and not latencies.size):
        return np.empty(0)
    return seen.latency_by_step


def has_latencies(samples: RunSamples, monitor: str) -> bool:
    """Return True if outputs with a latency were expected of a monitor.

    Outputs of a timer have none.
    """
    segments = (segment for played in samples.iterations.values() for segment in played)
    return any(step_latencies(segment.monitors[monitor]).size for segment in segments)


def thin_indices(values: StepLatencies, max_points: int) -> NDArray[np.int64]:
    """Return which values to draw: the extremes of each interval, at most `max_points` in all.

    The extremes are never left out; missing values are.
    """
    known = np.flatnonzero(~np.isnan(values))
    if known.size <= max_points:
        return known
    kept: set[int] = set()
    for part in np.array_split(known, max_points // 2):
        kept.add(int(part[np.argmin(values[part])]))
        kept.add(int(part[np.argmax(values[part])]))
    return np.array(sorted(kept), dtype=np.int64)


def missed_runs(missed: NDArray[np.bool_], max_runs: int = 400) -> list[tuple[int, int]]:
    """Return runs of missed steps as (first, count); neighbours are joined if there are many."""
    edges = np.flatnonzero(np.diff(np.concatenate(([False], missed, [False])).astype(np.int8)))
    runs = [(int(first), int(end)) for first, end in edges.reshape(-1, 2)]
    gap = 0
    while len(runs) > max_runs:
        gap = gap * 2 + 1
        joined = [runs[0]]
        for first, end in runs[1:]:
            if first - joined[-1][1] <= gap:
                joined[-1] = (joined[-1][0], end)
            else:
                joined.append((first, end))
        runs = joined
    return [(first, end - first) for first, end in runs]


_CURVE_POINTS = 300
_MAX_CURVES = 24
"""The legend of more curves leaves them no room."""
_MIN_LOG_RATIO = 20.0
"""From this ratio of the largest latency to the median on, the latency axis is logarithmic."""


def percentile_chart(name: str, monitor: str, samples: RunSamples, verdict: Verdict) -> Chart:
    """Draw a curve for each offered rate, with the limits and bounds of its requirements.

    Args:
        name: of the chart, unique in its page.
        monitor: its name.
        samples: of the run.
        verdict: of the run.
    """
    all_rates = sorted(samples.iterations)
    rates = all_rates[-_MAX_CURVES:]
    description = (
        f"Latency of {monitor} by percentile, one curve for each of "
        f"{', '.join(show_rate(rate, pace_of(samples.mode)) for rate in rates)}. The horizontal "
        "axis is logarithmic in the share of messages that took longer."
    )
    title = f"Latency by percentile: {monitor}"
    if len(all_rates) > len(rates):
        title += f", the highest {len(rates)} of {len(all_rates)} rates"

    def paint(sketch: chart.ChartBuilder) -> None:
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
            requirement
            for requirement in verdict.requirements
            if requirement.monitor == monitor
            and requirement.at_hz in rates
            and _is_drawn(requirement)
        ]
        for limit in limits:
            _bar(axes, limit, rates.index(limit.at_hz or 0.0))
        _percentile_axes(axes, total)
        is_wide = bool(median) and largest > _MIN_LOG_RATIO * min(median)
        chart.scale_values(axes, logarithmic=is_wide)
        for limit in limits:
            _label(axes, limit)
        if sketch.labels:
            sketch.figure.legend(loc="outside upper left", ncols=6)
        sketch.register_axes(axes, "percentile", "ms")

    return chart.draw(name, title, description, 3.4, paint)


def _pooled(
    iterations: tuple[SegmentSamples, ...], monitor: str
) -> tuple[NDArray[np.float64], int]:
    """Return all latencies at a rate in ascending order, and how many messages were lost."""
    seen = [iteration.monitors[monitor] for iteration in iterations]
    values = np.sort(known_latencies(seen))
    return values, sum(sample.missed for sample in seen)


def _curve(
    sketch: chart.ChartBuilder,
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
        x,
        y,
        where="pre",
        color=chart.colour(number),
        linestyle=chart.line_style(number),
        label=label,
    )
    sketch.series(line, label)
    if lost:
        axes.plot(
            x[-1], y[-1], marker="^", color=chart.colour(number), markersize=8, linestyle="none"
        )
        text = f"{show(lost / n, 'share')} lost"
        chart.write(axes, text, (x[-1], y[-1]), (7, -3), chart.colour(number), fontsize=9)


def _ranks(n: int) -> NDArray[np.int64]:
    """Return the ranks to draw, denser near the largest."""
    if n <= _CURVE_POINTS:
        return np.arange(1, n + 1)
    from_end = np.unique(np.geomspace(1, n, _CURVE_POINTS).astype(np.int64))
    return (n + 1 - from_end)[::-1]


def _is_drawn(one: RequirementVerdict) -> bool:
    """Return whether it is a limit of a percentile of the latency.

    That of a ratio is on no axis.
    """
    if one.compared is not None:
        return False
    family, _, part = one.metric.rpartition(".")
    drawn = family.endswith("latency")
    return drawn and quantile(part) is not None and one.limit is not None


def _place(one: RequirementVerdict) -> tuple[float, float]:
    """Return where the limit is on the axes: its percentile, and the limit in ms."""
    q = quantile(one.metric.rpartition(".")[2])
    return 1 / (1 - (q or 0.0)), (one.limit or 0.0) * 1e3


def _ink(one: RequirementVerdict) -> str:
    return chart.PALETTE[chart.OUTCOME_COLOURS[one.outcome]]


def _bar(axes: Axes, one: RequirementVerdict, number: int) -> None:
    """The limit as a bar at its percentile, with the bounds of the estimate."""
    x, y = _place(one)
    axes.hlines(y, x / 1.6, x * 1.6, color=_ink(one), linewidth=2.4)
    if one.lower is not None and one.upper is not None and np.isfinite(one.upper):
        axes.vlines(
            x, one.lower * 1e3, one.upper * 1e3, color=chart.colour(number), linewidth=5, alpha=0.45
        )


def _label(axes: Axes, one: RequirementVerdict) -> None:
    """The text of a limit, on the side of the bar without the curve."""
    x, y = _place(one)
    part = one.metric.rpartition(".")[2]
    above = not one.lost and one.estimate is not None and y / 1e3 > one.estimate
    text = printable(f"{part} limit {show(one.limit, one.unit)} {at_rate(one.at_hz or 0.0)}")
    chart.inside_label(axes, x, y, text, _ink(one), above=above)


def _percentile_axes(axes: Axes, total: int) -> None:
    """An axis of shares up to one of `total` messages, which expands the tail; times in ms."""
    axes.set_xscale("log")
    axes.set_xlim(1, max(total * 1.8, 20))
    shown = {1: "0 %", 2: "50 %", 10: "90 %", 20: "95 %", 100: "99 %", 1000: "99.9 %"}
    shown |= {10_000: "99.99 %", 100_000: "99.999 %", 1_000_000: "99.9999 %"}
    ticks = {place: text for place, text in shown.items() if place <= axes.get_xlim()[1]}
    axes.set_xticks([*ticks], labels=[*ticks.values()])
    axes.set_xticks([], minor=True)
    axes.set_xlabel("share of messages at or below")
    axes.set_ylabel("latency, ms")


_MAX_POINTS = 1_200
"""Messages that are drawn for each rate."""

_MAX_SEPARATORS = 300
"""Iterations that are drawn apart: more of them would be an area."""

_MESSAGE_RATES = 6

_WORST_FIRST = ("fail", "inconclusive", "pass")


def messages_chart(name: str, monitor: str, samples: RunSamples, verdict: Verdict) -> Chart:
    """Draw a row for each offered rate; iterations follow each other from left to right.

    See `percentile_chart`.
    """
    rates = sorted(samples.iterations)
    shown = rates[-_MESSAGE_RATES:]
    apart = max((len(samples.iterations[rate]) for rate in shown), default=0) <= _MAX_SEPARATORS
    description = (
        f"Latency of each message at {monitor}, in the order of playing, a row for each offered "
        "rate. Bars at the top of a row are missed messages"
        + ("; vertical lines separate the iterations." if apart else ".")
    )
    thin = False

    def paint(sketch: chart.ChartBuilder) -> None:
        nonlocal thin
        grid = sketch.figure.subplots(len(shown), 1, squeeze=False)
        for row, rate in enumerate(shown):
            axes = grid[row][0]
            limits = [
                requirement
                for requirement in verdict.requirements
                if requirement.monitor == monitor
                and requirement.at_hz == rate
                and "latency." in requirement.metric
                # The limit of a ratio is no time.
                and requirement.compared is None
            ]
            number = row + len(rates) - len(shown)
            thin |= _row(sketch, axes, samples, monitor, rate, number, limits)
        grid[-1][0].set_xlabel("message")
        notes = []
        if thin:
            notes.append(
                f"In rows of more than {_MAX_POINTS:,} messages, only the fastest and the slowest "
                "of each interval are drawn; misses are always marked."
            )
        if len(shown) < len(rates):
            notes.append(f"The highest {len(shown)} of {len(rates)} rates are drawn.")
        sketch.note = " ".join(notes)

    height = 0.5 + 1.5 * len(shown)
    return chart.draw(name, f"Latency by message: {monitor}", description, height, paint)


def _row(
    sketch: chart.ChartBuilder,
    axes: Axes,
    samples: RunSamples,
    monitor: str,
    rate: float,
    number: int,
    limits: list[RequirementVerdict],
) -> bool:
    """Draw one rate; returns whether messages were left out."""
    parts = [step_latencies(played.monitors[monitor]) for played in samples.iterations[rate]]
    values = np.concatenate(parts) if parts else np.empty(0)
    kept = thin_indices(values, _MAX_POINTS)
    label = show_rate(rate, pace_of(samples.mode))
    (line,) = axes.plot(
        kept + 1, values[kept] * 1e3, ".", color=chart.colour(number), markersize=3, label=label
    )
    sketch.series(line, label)
    drawn = [
        (output_line.limit * 1e3, _ink(output_line))
        for output_line in limits
        if output_line.limit is not None
    ]
    top = float(np.nanmax(values)) * 1e3 if kept.size else 1.0
    top = max(top, *(limit for limit, _ in drawn), 0.0)
    axes.set_ylim(0, top * 1.25)
    for limit, ink in drawn:
        axes.axhline(limit, color=ink, linewidth=1, linestyle="--")
    ends = np.cumsum([part.size for part in parts])[:-1] + 0.5
    axes.vlines(
        ends if len(parts) <= _MAX_SEPARATORS else [],
        0,
        1,
        transform=axes.get_xaxis_transform(),
        color=chart.PALETTE["quiet"],
        linewidth=0.6,
    )
    missed = np.isnan(values)
    if missed.any():
        bars = [(first + 0.5, count) for first, count in missed_runs(missed)]
        axes.broken_barh(
            bars, (top * 1.17, top * 0.08), facecolor=chart.PALETTE["bad"], linewidth=0
        )
    axes.set_xlim(0.5, max(values.size, 1) + 0.5)
    axes.set_ylabel(f"{label}\nms")
    count = int(missed.sum())
    text = f"{count:,} of {values.size:,} missed" if count else f"none of {values.size:,} missed"
    axes.set_title(
        # What the source of a live graph sent is unknown.
        f"{values.size:,} messages" if samples.mode == "live" else text,
        loc="right",
        fontsize=8,
        color=chart.PALETTE["bad" if count else "quiet"],
    )
    if limits:
        worst = min((output_line.outcome for output_line in limits), key=_WORST_FIRST.index)
        axes.set_title(
            printable("limit: " + " · ".join(output_line.text.strip() for output_line in limits)),
            loc="left",
            fontsize=8,
            color=chart.PALETTE[chart.OUTCOME_COLOURS[worst]],
        )
    sketch.register_axes(axes, "message", "ms")
    return bool(kept.size < values.size - count)
