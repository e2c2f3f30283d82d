"""Charts of load: throughput and drops by offered rate; CPU and memory over the run."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from r2bspec.diagnostics.quote import printable
from r2bspec.judge.measure.host_usage import MACHINE_INDEX, ProcessSamples, spaced_indices
from r2bspec.judge.measure.metrics import RunMetrics
from r2bspec.judge.measure.run_samples import match_segment
from r2bspec.judge.measure.units import show
from r2bspec.judge.verdict import Verdict
from r2bspec.plan.plan import MonitorPlan
from r2bspec.record.run_folder import Run
from r2bspec.record.run_record import Segment
from r2bspec.record.sample_arrays import Rows
from r2bspec.report.document import Chart
from r2bspec.report.html import chart
from r2bspec.report.html.chart import PALETTE, ChartBuilder, colour, draw, line_style, write
from r2bspec.report.result_table import monitor_names
from r2bspec.report.wording import all_probes

if TYPE_CHECKING:
    from matplotlib.axes import Axes


_THROUGHPUT = "throughput.mean"
_WHOLE_MACHINE: Final = "whole machine"

_MIN_LOG_RATIO = 8.0
"""From this ratio of the highest to the lowest rate on, rates are on a logarithmic axis."""

_PROBE_MARKERS: Final = (
    (True, "o", "probe: sustained"),
    (False, "x", "probe: not sustained"),
    (None, "D", "probe: undecided"),
)
_DISTURBED: Final = "probe: host interference"
_COLOURS: Final = {True: "good", False: "bad", None: "quiet"}


def load_curve_chart(name: str, metrics: RunMetrics, run: Run | None, verdict: Verdict) -> Chart:
    """Draw the throughput above, and the drop rate below; probes of the search are hollow."""
    probes = all_probes(metrics)
    rates = [*(rate.offered_hz for rate in metrics.rates), *(probe.rate_hz for probe in probes)]
    description = (
        "Throughput above and drop rate below, by offered rate. On the dotted line all offered "
        "messages were delivered. Hollow marks are probes: circles were sustained, crosses were "
        "not, diamonds were undecided. A band marks the peak found by the search."
    )
    if any(probe.disturbed for probe in probes):
        description += " Squares are around probes that other programs disturbed."

    def paint(sketch: chart.ChartBuilder) -> None:
        upper, lower = sketch.figure.subplots(2, 1, sharex=True, height_ratios=(3, 2))
        wide = max(rates) > _MIN_LOG_RATIO * min(rates)
        ends = (min(rates) * 0.85, max(rates) * 1.15) if wide else (0, max(rates) * 1.08)
        upper.plot(ends, ends, ":", color=chart.PALETTE["quiet"], label="offered rate")
        _bracket(metrics, (upper, lower))
        for number, monitor in enumerate(monitor_names(metrics)):
            _monitor(sketch, (upper, lower), number, monitor, metrics)
        _probes(sketch, upper, metrics)
        if run is not None:
            _probe_drops(sketch, lower, metrics, run)
        upper.set_xlim(*ends)
        if wide:
            upper.set_xscale("log")
            chart.plain_numbers(upper.xaxis)
        # On two logarithmic axes the offered rate stays a straight line.
        chart.scale_values(upper, logarithmic=wide and _min_delivered(metrics) > 0)
        lower.set_ylim(-3, 103)
        _limits(upper, lower, verdict)
        upper.set_ylabel("throughput, Hz")
        lower.set_ylabel("dropped, %")
        lower.set_xlabel("offered rate, Hz")
        sketch.figure.legend(loc="outside upper left", ncols=5)
        sketch.register_axes(upper, "Hz", "Hz")
        sketch.register_axes(lower, "Hz", "%")

    return chart.draw(name, "Throughput and drops by offered rate", description, 4.2, paint)


def _min_delivered(metrics: RunMetrics) -> float:
    delivered = [probe.delivered_hz for probe in all_probes(metrics)]
    for rate in metrics.rates:
        delivered += [
            interval.low for name in rate.spread if (interval := rate.spread[name].get(_THROUGHPUT))
        ]
        delivered += [seen.throughput_hz for seen in rate.pooled.monitors.values()]
    return min(delivered, default=0.0)


def _monitor(
    sketch: chart.ChartBuilder,
    panels: tuple[Axes, Axes],
    number: int,
    monitor: str,
    metrics: RunMetrics,
) -> None:
    """A filled mark for each rate, with the range over its iterations as a bar."""
    upper, lower = panels
    x = [rate.offered_hz for rate in metrics.rates]
    seen = [rate.pooled.monitors[monitor] for rate in metrics.rates]
    ink = chart.colour(number)
    style: dict[str, Any] = {
        "color": ink,
        "marker": chart.marker(number),
        "linestyle": "-",
        "linewidth": 1,
    }
    (line,) = upper.plot(
        x, [sample.throughput_hz for sample in seen], label=printable(monitor), zorder=4, **style
    )
    sketch.series(line, f"{monitor}: throughput")
    drops = [(sample.drop_rate or 0) * 100 for sample in seen]
    (line,) = lower.plot(x, drops, zorder=4, **style)
    sketch.series(line, f"{monitor}: drop rate")
    for axes, metric, factor in ((upper, _THROUGHPUT, 1), (lower, "drop_rate", 100)):
        bars = [
            (rate.offered_hz, spread.low * factor, spread.high * factor)
            for rate in metrics.rates
            if (spread := rate.spread[monitor].get(metric)) is not None
        ]
        # All at once: a run may have hundreds of rates.
        if bars:
            axes.vlines(*zip(*bars, strict=True), color=ink, linewidth=4, alpha=0.4)


def _draw_probes(
    sketch: chart.ChartBuilder, axes: Axes, points: Sequence[tuple[float, float]], **style: Any
) -> None:
    """Hollow marks; those with a label are a series of the legend."""
    if not points:
        return
    style = {"linestyle": "none", "markerfacecolor": "none", "markersize": 6, **style}
    (line,) = axes.plot(*zip(*points, strict=True), **style)
    sketch.series(line, style.get("label", "probe: drop rate"))


def _probes(sketch: chart.ChartBuilder, axes: Axes, metrics: RunMetrics) -> None:
    """What each probe delivered, with a square around those that other programs disturbed."""
    probes = all_probes(metrics)
    for holds, shape, name in _PROBE_MARKERS:
        points = [(probe.rate_hz, probe.delivered_hz) for probe in probes if probe.holds is holds]
        ink = chart.PALETTE[_COLOURS[holds]]
        _draw_probes(sketch, axes, points, marker=shape, color=ink, label=name, zorder=3)
    points = [(probe.rate_hz, probe.delivered_hz) for probe in probes if probe.disturbed]
    square = {"marker": "s", "markersize": 11, "color": chart.PALETTE["quiet"], "zorder": 2}
    _draw_probes(sketch, axes, points, label=_DISTURBED, **square)


def _probe_drops(sketch: chart.ChartBuilder, axes: Axes, metrics: RunMetrics, run: Run) -> None:
    """The drop rate of each probe, at the monitor that missed most."""
    outcomes = {
        probe.segment: probe.holds for probe in (metrics.search.probes if metrics.search else ())
    }
    for holds, shape, _ in _PROBE_MARKERS:
        points = []
        for segment in run.record.segments:
            if segment.id in outcomes and outcomes[segment.id] is holds and segment.kind == "probe":
                lost = [_lost(run, segment, monitor) for monitor in run.plan.monitors]
                points.append((segment.rate_hz, max(lost, default=0.0) * 100))
        _draw_probes(sketch, axes, points, marker=shape, color=chart.PALETTE[_COLOURS[holds]])


def _lost(run: Run, segment: Segment, monitor: MonitorPlan) -> float:
    *_, matched = match_segment(run, segment, monitor)
    if not matched.pairs_known or not matched.trigger_steps.size:
        return 0.0
    return 1.0 - float(matched.answered.mean())


def _bracket(metrics: RunMetrics, panels: tuple[Axes, Axes]) -> None:
    search = metrics.search
    if search is None or search.holds_hz is None:
        return
    upper_hz = search.upper_hz
    if upper_hz is not None:
        for axes in panels:
            axes.axvspan(
                search.holds_hz, upper_hz, color=chart.PALETTE["s4"], alpha=0.25, linewidth=0
            )
    text = f"peak {'at least ' if upper_hz is None else ''}{show(search.holds_hz, 'Hz')}"
    style = {"xycoords": ("data", "axes fraction"), "ha": "right", "va": "top"}
    chart.write(panels[0], text, (search.holds_hz, 1), (-3, -2), chart.PALETTE["s4"], **style)


def _limits(upper: Axes, lower: Axes, verdict: Verdict) -> None:
    """A short bar at the rate of each requirement on throughput or drops."""
    for requirement in verdict.requirements:
        # The limit of a ratio is on neither axis.
        if (
            requirement.limit is None
            or requirement.at_hz is None
            or requirement.compared is not None
        ):
            continue
        ink = chart.PALETTE[chart.OUTCOME_COLOURS[requirement.outcome]]
        if requirement.metric.endswith("throughput.mean"):
            axes, y = upper, requirement.limit
        elif requirement.metric.endswith("drop_rate"):
            axes, y = lower, requirement.limit * 100
        else:
            continue
        axes.hlines(
            y,
            requirement.at_hz * 0.88,
            requirement.at_hz * 1.14,
            color=ink,
            linewidth=2.4,
            zorder=5,
        )
        chart.inside_label(
            axes, requirement.at_hz, y, f"limit {show(requirement.limit, requirement.unit)}", ink
        )


_MAX_POINTS = 300
"""Samples that are drawn of each process, and of each series of interference."""

_MIB = 2**20


def loads_chart(name: str, run: Run) -> Chart | None:
    """Draw processor time, and memory below it; None if nothing was sampled."""
    rows = run.resources()
    if not rows.size:
        return None
    start_ns = int(rows["time_ns"].min())
    description = (
        "Processor time of each process, where 100 % is one core, and its memory below, over the "
        "time since the first sample. The background shows the phases of the run."
    )

    def paint(sketch: ChartBuilder) -> None:
        panels = sketch.figure.subplots(2, 1, sharex=True, height_ratios=(3, 2))
        upper, lower = panels
        most = 1
        names = [(number, listed.name) for number, listed in enumerate(run.record.processes)]
        # A confirmation run starts processes of the same names: they keep their colours.
        places = {
            process: place for place, process in enumerate(dict.fromkeys(n for _, n in names))
        }
        places[_WHOLE_MACHINE] = len(places)
        shown: set[str] = set()
        samples = ProcessSamples(rows)
        for index, process in [*names, (MACHINE_INDEX, _WHOLE_MACHINE)]:
            of_one = samples.rows(index)
            if of_one.size > 2:
                again = process in shown
                shown.add(process)
                group = _process(
                    *(sketch, (upper, lower), places[process], process, of_one, start_ns),
                    again=again,
                )
                most = max(most, group)
        _draw_phases(run, panels, start_ns, int(rows["time_ns"].max()))
        upper.set_ylim(bottom=0)
        lower.set_ylim(bottom=0)
        upper.set_xlim(left=0)
        upper.set_ylabel("CPU, % of a core")
        lower.set_ylabel("memory, MiB")
        lower.set_xlabel("seconds")
        sketch.figure.legend(
            *upper.get_legend_handles_labels(), loc="outside lower center", ncols=4
        )
        sketch.register_axes(upper, "s", "%")
        sketch.register_axes(lower, "s", "MiB")
        if most > 1:
            sketch.note = f"Each point is the mean of up to {most} samples."

    return draw(name, "CPU and memory over the run", description, 4.6, paint)


def devices_chart(name: str, run: Run) -> Chart | None:
    """Draw busy GPUs, and power below them; None if nothing was sampled."""
    rows = ProcessSamples(run.devices()).rows(MACHINE_INDEX)
    if rows.size <= 2:
        return None
    rows, ends, _ = _grouped(rows)
    start_ns = int(rows["time_ns"][0])
    times = (rows["time_ns"][ends] - start_ns) / 1e9

    def paint(sketch: ChartBuilder) -> None:
        panels = sketch.figure.subplots(2, 1, sharex=True)
        for number, (field, label, panel, factor) in enumerate(_DEVICE_LINES):
            growth = _percent(rows[field][ends], times) * factor
            if np.isfinite(growth).any():
                middles = (times[1:] + times[:-1]) / 2
                style: dict[str, Any] = {"color": colour(number), "linestyle": line_style(number)}
                (line,) = panels[panel].plot(middles, growth, label=label, **style)
                sketch.series(line, label)
        _draw_phases(run, panels, start_ns, int(rows["time_ns"].max()))
        panels[0].set_xlim(left=0)
        panels[1].set_xlabel("seconds")
        for axes, label, unit in zip(panels, ("busy, %", "power, W"), ("%", "W"), strict=True):
            axes.set_ylim(bottom=0)
            axes.set_ylabel(label)
            sketch.register_axes(axes, "s", unit)
        sketch.figure.legend(loc="outside lower center", ncols=5)

    description = "Busy GPUs, where 100 % is one GPU, and power below, over the time of the run."
    return draw(name, "GPUs and power over the run", description, 4.2, paint)


_DEVICE_LINES: Final = (
    ("busy_s", "GPU", 0, 1.0),
    ("encoder_s", "encoder", 0, 1.0),
    ("decoder_s", "decoder", 0, 1.0),
    ("gpu_j", "power of GPUs", 1, 0.01),
    ("package_j", "power of processors", 1, 0.01),
)
"""Field, label, panel, and factor of the growth in percent of the time."""


def _process(
    sketch: ChartBuilder,
    panels: tuple[Axes, Axes],
    number: int,
    name: str,
    rows: Rows,
    start_ns: int,
    *,
    again: bool = False,
) -> int:
    """Draw one process; returns how many samples make one point.

    `again` leaves it out of the legend, which has another process of its name.
    """
    rows, ends, group = _grouped(rows)
    times = (rows["time_ns"][ends] - start_ns) / 1e9
    cpu = _percent(rows["cpu_s"][ends], times)
    machine = name == _WHOLE_MACHINE
    style: dict[str, Any] = {
        "color": PALETTE["quiet"] if machine else colour(number),
        "linestyle": "-" if machine else line_style(number),
        "linewidth": 0.8 if machine else 1.3,
    }
    (line,) = panels[0].plot(
        (times[1:] + times[:-1]) / 2, cpu, label="" if again else printable(name), **style
    )
    sketch.series(line, f"{name}: CPU")
    if not machine:  # all memory in use would flatten every process
        memory = _means(rows["memory_bytes"] / _MIB, ends)
        (line,) = panels[1].plot(times[1:], memory, **style)
        sketch.series(line, f"{name}: memory")
    return group


def _grouped(rows: Rows) -> tuple[Rows, NDArray[np.int64], int]:
    """Rows with some time between them, the ends of groups of them, and the size of a group.

    What the rows count adds up, so the difference over a group is exactly the mean of the group.
    """
    rows = rows[spaced_indices(rows["time_ns"])]
    group = max(1, -(-rows.size // _MAX_POINTS))
    ends = np.unique(np.append(np.arange(0, rows.size, group), rows.size - 1))
    return rows, ends, group


def _percent(seconds: NDArray[np.float64], times: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the growth of a number of seconds, in percent of the time."""
    spans = np.diff(times)
    grown = np.diff(seconds) * 100
    return np.asarray(np.divide(grown, spans, where=spans > 0, out=np.zeros(spans.size)))


def _means(values: NDArray[np.float64], ends: NDArray[np.int64]) -> NDArray[np.float64]:
    totals = np.concatenate(([0.0], np.cumsum(values)))
    return np.asarray((totals[ends[1:] + 1] - totals[ends[:-1] + 1]) / np.diff(ends))


def _run_phases(run: Run, end_ns: int) -> list[tuple[str, int, int]]:
    """Return each phase with its beginning and its end."""
    begun = [
        (text.removeprefix("phase "), at_ns)
        for at_ns, text in run.record.events
        if text.startswith("phase ")
    ]
    ends = [*(at_ns for _, at_ns in begun[1:]), end_ns]
    return [(name, at_ns, max(end, at_ns)) for (name, at_ns), end in zip(begun, ends, strict=False)]


def _draw_phases(run: Run, panels: Sequence[Axes], start_ns: int, end_ns: int) -> None:
    whole = max(end_ns - start_ns, 1)
    for number, (phase, at_ns, phase_end) in enumerate(_run_phases(run, end_ns)):
        first, last = (max(at_ns, start_ns) - start_ns) / 1e9, (phase_end - start_ns) / 1e9
        if last <= first:
            continue
        if number % 2:
            for axes in panels:
                axes.axvspan(first, last, color=PALETTE["band"], linewidth=0, zorder=0)
        if (phase_end - at_ns) / whole > 0.012 * (len(phase) + 1):
            middle = ((first + last) / 2, 1)
            style = {"xycoords": ("data", "axes fraction"), "ha": "center", "va": "bottom"}
            write(panels[0], printable(phase), middle, (0, 2), PALETTE["quiet"], **style)
