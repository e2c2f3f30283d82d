"""Charts of load: throughput and drops by offered rate; CPU and memory over the run."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Final

import numpy as np

from r2bspec.diagnostics.quote import printable
from r2bspec.judge.measure.host_usage import MACHINE_INDEX, ProcessSamples, spaced_indices
from r2bspec.judge.measure.metrics import RunMetrics
from r2bspec.judge.measure.units import show
from r2bspec.judge.verdict import RequirementVerdict, Verdict
from r2bspec.record.run_folder import Run
from r2bspec.record.sample_arrays import Rows
from r2bspec.report.document import Chart
from r2bspec.report.html.chart import (
    OUTCOME_INKS,
    Axis,
    Band,
    Label,
    Panel,
    Series,
    Strokes,
    dashes,
    draw,
    ink,
    value_axis,
)
from r2bspec.report.result_table import monitor_names
from r2bspec.report.wording import all_probes

_THROUGHPUT: Final = "throughput.mean"

_MIN_LOG_RATIO: Final = 8.0
"""From this ratio of the highest to the lowest rate on, rates are on a logarithmic axis."""

_PROBES: Final = (
    (True, "circle", "good", "probe: sustained"),
    (False, "cross", "bad", "probe: not sustained"),
    (None, "diamond", "quiet", "probe: undecided"),
)

Marks = list[Series | Strokes | Band | Label]


def load_curve_chart(name: str, metrics: RunMetrics, verdict: Verdict) -> Chart:
    """Draw the throughput above, and the drop rate below; probes of the search are hollow."""
    probes = all_probes(metrics)
    rates = [*(rate.offered_hz for rate in metrics.rates), *(probe.rate_hz for probe in probes)]
    wide = max(rates) > _MIN_LOG_RATIO * min(rates)
    low, high = (min(rates) * 0.85, max(rates) * 1.15) if wide else (0.0, max(rates) * 1.08)
    upper: Marks = [Strokes([((low, low), (high, high))], "quiet", 1.4, dashes="2 4")]
    lower: Marks = []
    for number, monitor in enumerate(monitor_names(metrics)):
        _add_monitor(upper, lower, number, monitor, metrics)
    for holds, mark, colour, text in _PROBES:
        points = [(one.rate_hz, one.delivered_hz) for one in probes if one.holds is holds]
        if points:
            upper.append(Series(points, text, colour, text, joined=False, mark=mark, filled=False))
    search = metrics.search
    if search is not None and search.holds_hz is not None:
        least = "at least " if search.upper_hz is None else ""
        upper.append(Label(f"peak {least}{show(search.holds_hz, 'Hz')}", search.holds_hz, high))
        if search.upper_hz is not None:
            for marks in (upper, lower):
                marks.append(Band(search.holds_hz, search.upper_hz, "s4", 0.25))
    for requirement in verdict.requirements:
        upper += _limit(requirement, _THROUGHPUT, 1)
        lower += _limit(requirement, "drop_rate", 100)
    delivered = [up for mark in upper if isinstance(mark, Series) for _, up in mark.points]
    # On two logarithmic axes the offered rate stays a straight line.
    logarithmic = wide and min(delivered, default=0.0) > 0
    panels = [
        Panel(
            Axis("", "Hz", low, high, wide),
            value_axis("throughput, Hz", "Hz", [*delivered, max(rates)], logarithmic=logarithmic),
            upper,
            190,
        ),
        Panel(
            Axis("offered rate, Hz", "Hz", low, high, wide),
            Axis("dropped, %", "%", -3, 103),
            lower,
            120,
        ),
    ]
    description = (
        "Throughput above and drop rate below, by offered rate. On the dotted line all offered "
        "messages were delivered. Hollow marks are probes: circles were sustained, crosses were "
        "not, diamonds were undecided. A band marks the peak found by the search."
    )
    return draw(name, "Throughput and drops by offered rate", description, panels)


def _add_monitor(
    upper: Marks, lower: Marks, number: int, monitor: str, metrics: RunMetrics
) -> None:
    """Add a mark for each rate, with the range over its iterations as a bar."""
    seen = [(rate.offered_hz, rate.pooled.monitors[monitor]) for rate in metrics.rates]
    colour, name = ink(number), printable(monitor)
    throughput = [(hz, one.throughput_hz) for hz, one in seen]
    drops = [(hz, (one.drop_rate or 0) * 100) for hz, one in seen]
    line = dashes(number)
    upper.append(
        Series(throughput, f"{monitor}: throughput", colour, name, dashes=line, mark="dot")
    )
    lower.append(Series(drops, f"{monitor}: drop rate", colour, dashes=line, mark="dot"))
    ranges = [
        ((rate.offered_hz, spread.low), (rate.offered_hz, spread.high))
        for rate in metrics.rates
        if (spread := rate.spread[monitor].get(_THROUGHPUT)) is not None
    ]
    upper.append(Strokes(ranges, colour, 5, opacity=0.4))


def _limit(one: RequirementVerdict, metric: str, factor: float) -> Iterator[Strokes | Label]:
    """Yield a short bar at the rate of a requirement on a metric; a ratio is on no axis."""
    if one.limit is None or not one.at_hz or one.compared or not one.metric.endswith(metric):
        return
    colour, y = OUTCOME_INKS[one.outcome], one.limit * factor
    yield Strokes([((one.at_hz * 0.88, y), (one.at_hz * 1.14, y))], colour, 3)
    yield Label(f"limit {show(one.limit, one.unit)}", one.at_hz, y, colour)


_MAX_POINTS: Final = 300
"""Samples that are drawn of each process."""

_MIB: Final = 2**20
_WHOLE_MACHINE: Final = "whole machine"


def loads_chart(name: str, run: Run) -> Chart | None:
    """Draw processor time, and memory below it; None if nothing was sampled."""
    rows = run.resources()
    if not rows.size:
        return None
    start_ns, end_ns = int(rows["time_ns"].min()), int(rows["time_ns"].max())
    samples = ProcessSamples(rows)
    names = [listed.name for listed in run.record.processes]
    # Each start has a process of the name, which keeps its colour.
    places = {process: place for place, process in enumerate(dict.fromkeys(names))}
    phases = [*_phases(run, start_ns, end_ns)]
    upper: Marks = [Band(first, last) for _, first, last in phases[1::2]]
    lower: Marks = [*upper]
    for index, process in [*enumerate(names), (MACHINE_INDEX, _WHOLE_MACHINE)]:
        of_one = samples.rows(index)
        if of_one.size > 2:
            times, cpu, memory = _load(of_one, start_ns)
            machine = process == _WHOLE_MACHINE
            colour, line = (
                ("quiet", "") if machine else (ink(places[process]), dashes(places[process]))
            )
            legend = printable(process)
            upper.append(
                Series(
                    [*zip(times, cpu, strict=True)], f"{process}: CPU", colour, legend, dashes=line
                )
            )
            if not machine:  # all memory in use would flatten every process
                lower.append(
                    Series(
                        [*zip(times, memory, strict=True)],
                        f"{process}: memory",
                        colour,
                        dashes=line,
                    )
                )
    end_s = max((end_ns - start_ns) / 1e9, 1e-3)
    panels = [
        Panel(Axis(title, "s", 0.0, end_s), _axis_of(text, unit, marks), marks, height)
        for title, text, unit, marks, height in (
            ("", "CPU, % of a core", "%", upper, 190),
            ("seconds", "memory, MiB", "MiB", lower, 120),
        )
    ]
    high = panels[0].y.high
    upper += [
        Label(phase, (first + last) / 2, high)
        for phase, first, last in phases
        # The name of a short phase would cover those of the others.
        if last - first > 0.012 * (len(phase) + 1) * end_s
    ]
    description = (
        "Processor time of each process, where 100 % is one core, and its memory below, over the "
        "time since the first sample. The background shows the phases of the run."
    )
    return draw(name, "CPU and memory over the run", description, panels)


def _axis_of(title: str, unit: str, marks: Marks) -> Axis:
    values = [up for mark in marks if isinstance(mark, Series) for _, up in mark.points]
    return value_axis(title, unit, values)


def _load(rows: Rows, start_ns: int) -> tuple[list[float], list[float], list[float]]:
    """Return times in seconds, and CPU in percent and memory in MiB at these times.

    Of many samples some are left out: the CPU between two of them is the mean of all.
    """
    rows = rows[spaced_indices(rows["time_ns"])]
    rows = rows[:: max(1, -(-rows.size // _MAX_POINTS))]
    times = (rows["time_ns"] - start_ns) / 1e9
    spans = np.diff(times)
    cpu = np.diff(rows["cpu_s"]) * 100
    cpu = np.divide(cpu, spans, where=spans > 0, out=np.zeros(spans.size))
    return times[1:].tolist(), cpu.tolist(), (rows["memory_bytes"][1:] / _MIB).tolist()


def _phases(run: Run, start_ns: int, end_ns: int) -> Iterator[tuple[str, float, float]]:
    """Yield each phase with its beginning and its end, in seconds."""
    begun = [
        (text.removeprefix("phase "), at_ns)
        for at_ns, text in run.record.events
        if text.startswith("phase ")
    ]
    ends: Sequence[int] = [*(at_ns for _, at_ns in begun[1:]), end_ns]
    for (name, at_ns), end in zip(begun, ends, strict=False):
        first, last = ((max(each, start_ns) - start_ns) / 1e9 for each in (at_ns, end))
        if last > first:
            yield name, first, last
