"""CPU, memory and pressure over the run, with its phases in the background."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from r2bspec.diagnostics.quote import printable
from r2bspec.judge.measure.host_usage import MACHINE_INDEX, ProcessSamples, spaced_indices
from r2bspec.record.run_folder import Run
from r2bspec.record.sample_arrays import Rows
from r2bspec.report.html.chart import PALETTE, Chart, ChartBuilder, colour, draw, line_style, write
from r2bspec.report.timeline import phases

if TYPE_CHECKING:
    from matplotlib.axes import Axes


_MAX_POINTS = 300
"""Samples that are drawn of each process, and of each series of interference."""

_MIB = 2**20


def loads_chart(name: str, run: Run) -> Chart | None:
    """Processor time, memory, and, where known, the pressure, one below the other.

    None if nothing was sampled.
    """
    rows = run.resources()
    if not rows.size:
        return None
    interference = run.interference()
    pressed = has_pressure(interference)
    start_ns = int(rows["time_ns"].min())
    description = (
        "Processor time of each process, where 100 % is one core, and its memory below, over the "
        "time since the first sample. The background shows the phases of the run."
    )
    if pressed:
        description += (
            " At the bottom, the share of the time in which some task of the machine waited for a "
            "processor, or the machine itself was stopped."
        )

    def paint(sketch: ChartBuilder) -> None:
        heights = (3, 2, 1.5) if pressed else (3, 2)
        panels = sketch.figure.subplots(len(heights), 1, sharex=True, height_ratios=heights)
        upper, lower = panels[:2]
        most = 1
        names = [(number, listed.name) for number, listed in enumerate(run.record.processes)]
        # A confirmation run starts processes of the same names: they keep their colours.
        places = {
            process: place for place, process in enumerate(dict.fromkeys(n for _, n in names))
        }
        places["whole machine"] = len(places)
        shown: set[str] = set()
        samples = ProcessSamples(rows)
        for index, process in [*names, (MACHINE_INDEX, "whole machine")]:
            of_one = samples.rows(index)
            if of_one.size > 2:
                again = process in shown
                shown.add(process)
                group = _process(
                    *(sketch, (upper, lower), places[process], process, of_one, start_ns),
                    again=again,
                )
                most = max(most, group)
        _phases(run, panels, start_ns, int(rows["time_ns"].max()))
        upper.set_ylim(bottom=0)
        lower.set_ylim(bottom=0)
        upper.set_xlim(left=0)
        upper.set_ylabel("CPU, % of a core")
        lower.set_ylabel("memory, MiB")
        panels[-1].set_xlabel("seconds")
        sketch.figure.legend(
            *upper.get_legend_handles_labels(), loc="outside lower center", ncols=4
        )
        sketch.register_axes(upper, "s", "%")
        sketch.register_axes(lower, "s", "MiB")
        if pressed:
            paint_pressure(sketch, panels[2], interference, start_ns)
        if most > 1:
            sketch.note = f"Each point is the mean of up to {most} samples."

    title = "CPU, memory and pressure over the run" if pressed else "CPU and memory over the run"
    return draw(name, title, description, 6.0 if pressed else 4.6, paint)


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
    machine = name == "whole machine"
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
    """The growth of a number of seconds, in percent of the time."""
    spans = np.diff(times)
    grown = np.diff(seconds) * 100
    return np.asarray(np.divide(grown, spans, where=spans > 0, out=np.zeros(spans.size)))


def _means(values: NDArray[np.float64], ends: NDArray[np.int64]) -> NDArray[np.float64]:
    totals = np.concatenate(([0.0], np.cumsum(values)))
    return np.asarray((totals[ends[1:] + 1] - totals[ends[:-1] + 1]) / np.diff(ends))


def _phases(run: Run, panels: Sequence[Axes], start_ns: int, end_ns: int) -> None:
    whole = max(end_ns - start_ns, 1)
    for number, (phase, at_ns, phase_end) in enumerate(phases(run, end_ns)):
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


_SERIES = (
    ("waited_s", "tasks waited for a processor"),
    ("stolen_s", "stolen by other virtual machines"),
    ("throttled_s", "throttled"),
)


def has_pressure(rows: Rows) -> bool:
    """Whether there is anything to draw: at least one of them was sampled, twice."""
    return rows.size > 2 and any(np.isfinite(rows[field]).all() for field, _ in _SERIES)


def paint_pressure(sketch: ChartBuilder, axes: Axes, rows: Rows, start_ns: int) -> None:
    """Draw each series of host interference as its growth, in % of the time.

    Series that are always zero are not drawn, except the waiting: a line at zero shows that it was
    sampled.
    """
    rows, ends, _ = _grouped(rows)
    rows = rows[ends]
    times = (rows["time_ns"] - start_ns) / 1e9
    most = 10.0
    for number, (field, label) in enumerate(_SERIES):
        grown = np.diff(rows[field])
        if not np.isfinite(grown).all() or (number and not grown.any()):
            continue
        share = _percent(rows[field], times)
        (line,) = axes.plot(
            (times[1:] + times[:-1]) / 2,
            share,
            label=label,
            color=PALETTE["quiet"] if not number else colour(number),
            linestyle=line_style(number),
            linewidth=1.2,
        )
        sketch.series(line, label)
        most = max(most, float(share.max()) * 1.05)
    axes.set_ylim(0, most)
    axes.set_ylabel("pressure, %")
    # Above the panel: inside, it would cover the lines of a busy machine.
    axes.legend(loc="lower right", bbox_to_anchor=(1.0, 0.97), ncols=len(_SERIES), fontsize=8)
    sketch.register_axes(axes, "s", "%")
