"""The share of the time for which the run was kept waiting: pressure, steal, throttling."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from r2bspec.measure.host_usage import spaced_indices
from r2bspec.record.sample_arrays import Rows
from r2bspec.report.html.canvas import ChartBuilder, colour, line_style
from r2bspec.report.html.svg import PALETTE

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_MAX_POINTS = 300
"""Samples that are drawn of each series."""

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
    rows = rows[spaced_indices(rows["time_ns"])]
    group = max(1, -(-rows.size // _MAX_POINTS))
    # Sums, so that the difference over a group is exactly the group's mean.
    ends = np.unique(np.append(np.arange(0, rows.size, group), rows.size - 1))
    rows = rows[ends]
    times = (rows["time_ns"] - start_ns) / 1e9
    spans = np.diff(times)
    most = 10.0
    for number, (field, label) in enumerate(_SERIES):
        grown = np.diff(rows[field])
        if not np.isfinite(grown).all() or (number and not grown.any()):
            continue
        share = np.divide(grown * 100, spans, where=spans > 0, out=np.zeros(spans.size))
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
