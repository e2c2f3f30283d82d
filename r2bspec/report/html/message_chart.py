"""The latency of every message in the order of playing, with misses marked."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from r2bspec.diagnostics.quote import printable
from r2bspec.judge.verdict import RequirementVerdict, Verdict
from r2bspec.measure.metrics import pace_of
from r2bspec.measure.units import show_rate
from r2bspec.record.run_folder import Run
from r2bspec.report.html.canvas import OUTCOME_COLOURS, Chart, ChartBuilder, colour, draw
from r2bspec.report.html.step_chart import iterations_at, missed_runs, step_latencies, thin_indices
from r2bspec.report.html.svg import PALETTE

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_MAX_POINTS = 1_200
"""Messages that are drawn for each rate."""

_MAX_RATES = 6

_WORST_FIRST = ("fail", "inconclusive", "pass")


def messages_chart(
    name: str, monitor: str, run: Run, rates: list[float], verdict: Verdict
) -> Chart:
    """A row for each offered rate; iterations follow each other from left to right."""
    shown = rates[-_MAX_RATES:]
    description = (
        f"Latency of each message at {monitor}, in the order of playing, a row for each offered "
        "rate. Bars at the top of a row are missed messages; vertical lines separate the "
        "iterations."
    )
    thin = False

    def paint(sketch: ChartBuilder) -> None:
        nonlocal thin
        grid = sketch.figure.subplots(len(shown), 1, squeeze=False)
        for row, rate in enumerate(shown):
            axes = grid[row][0]
            limits = [
                one
                for one in verdict.requirements
                if one.monitor == monitor
                and one.at_hz == rate
                and "latency." in one.metric
                # The limit of a ratio is no time.
                and one.compared is None
            ]
            thin |= _row(sketch, axes, run, monitor, rate, row + len(rates) - len(shown), limits)
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
    return draw(name, f"Latency by message: {monitor}", description, height, paint)


def _row(
    sketch: ChartBuilder,
    axes: Axes,
    run: Run,
    monitor: str,
    rate: float,
    number: int,
    limits: list[RequirementVerdict],
) -> bool:
    """Draw one rate; returns whether messages were left out."""
    parts = [step_latencies(run, segment, monitor) for segment in iterations_at(run, rate)]
    values = np.concatenate(parts) if parts else np.empty(0)
    kept = thin_indices(values, _MAX_POINTS)
    label = show_rate(rate, pace_of(run.plan.playback_mode))
    (line,) = axes.plot(
        kept + 1, values[kept] * 1e3, ".", color=colour(number), markersize=3, label=label
    )
    sketch.series(line, label)
    top = float(np.nanmax(values)) * 1e3 if kept.size else 1.0
    for one in limits:
        if one.limit is not None:
            top = max(top, one.limit * 1e3)
    axes.set_ylim(0, top * 1.25)
    for one in limits:
        if one.limit is not None:
            name = OUTCOME_COLOURS[one.outcome]
            axes.axhline(one.limit * 1e3, color=PALETTE[name], linewidth=1, linestyle="--")
    for end in np.cumsum([part.size for part in parts])[:-1]:
        axes.axvline(end + 0.5, color=PALETTE["quiet"], linewidth=0.6)
    missed = np.isnan(values)
    if missed.any():
        bars = [(first + 0.5, count) for first, count in missed_runs(missed)]
        axes.broken_barh(bars, (top * 1.17, top * 0.08), facecolor=PALETTE["bad"], linewidth=0)
    axes.set_xlim(0.5, max(values.size, 1) + 0.5)
    axes.set_ylabel(f"{label}\nms")
    count = int(missed.sum())
    text = f"{count:,} of {values.size:,} missed" if count else f"none of {values.size:,} missed"
    axes.set_title(
        # What the source of a live graph sent is unknown.
        text if run.plan.inputs else f"{values.size:,} messages",
        loc="right",
        fontsize=8,
        color=PALETTE["bad" if count else "quiet"],
    )
    if limits:
        worst = min((one.outcome for one in limits), key=_WORST_FIRST.index)
        axes.set_title(
            printable("limit: " + " · ".join(one.text.strip() for one in limits)),
            loc="left",
            fontsize=8,
            color=PALETTE[OUTCOME_COLOURS[worst]],
        )
    sketch.register_axes(axes, "message", "ms")
    return bool(kept.size < values.size - count)
