"""Charts of histories: a chart for each metric, with the results on the axis."""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, Final

from r2bspec.compare.history import History, MetricHistory
from r2bspec.diagnostics.quote import printable
from r2bspec.judge.measure.units import show, unit_scale
from r2bspec.report.document import Chart
from r2bspec.report.html import chart
from r2bspec.report.html.chart import PALETTE, ChartBuilder
from r2bspec.report.html.page import own_text

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_MAX_MARKED: Final = 200
"""Results whose values have marks; of more, a line."""

_LINE_PT: Final = 10
"""Of a label."""

_TICKS: Final = 8
_COLOURS: Final = {"worse": "bad", "improved": "good"}


def trend_script(histories: Sequence[History]) -> str:
    """Return the script of the page, which shows the result at the pointer."""
    # Once for all charts of a benchmark: the script looks them up by their place.
    names = json.dumps(
        [
            [printable(f"{one.called}, {one.started_at}") for one in history.results]
            for history in histories
        ]
    ).replace("<", "\\u003c")
    return own_text("script.js").replace("const names = [];", f"const names = {names};")


def trend_chart(
    number: int, history: History, metric: MetricHistory, title: str, labels: Sequence[str]
) -> Chart:
    """Return the chart of a metric.

    Args:
        number: of the history in the page.
        history: of the metric.
        metric: with at least one value.
        title: of the chart.
        labels: a few words for each change of the metric.
    """
    description = f"{title} of {len(metric.values)} results, in the order of time."

    def paint(sketch: ChartBuilder) -> None:
        import matplotlib as mpl

        # The script shows every point; `draw` restores the setting.
        mpl.rcParams["path.simplify"] = False
        # Room for the same texts in each: to measure them takes as long as to draw.
        sketch.figure.set_layout_engine("none")
        axes = sketch.figure.add_axes((0.08, 0.11, 0.91, 0.86))
        most = max(abs(value) for value in metric.values if value is not None)
        unit = show(most, metric.unit).partition(" ")[2]
        scale = unit_scale(metric.unit, unit)
        for environment in range(len(history.environments)):
            _series(sketch, axes, history, metric, environment, title, scale)
        axes.margins(y=0.25)
        axes.set_xlim(-1, len(metric.values))
        _breaks(axes, history)
        for place, (change, label) in enumerate(zip(metric.changes, labels, strict=True)):
            ink = PALETTE[_COLOURS[change.outcome]]
            axes.axvline(change.after - 0.5, color=ink, linewidth=1)
            is_late = change.after > len(metric.values) / 2
            side = {"ha": "right" if is_late else "left", "va": "top"}
            # Neighbours stand on different lines.
            offset = (-3 if is_late else 3, -_LINE_PT * (place % 3))
            top = (change.after - 0.5, 1)
            chart.write(axes, label, top, offset, ink, xycoords=("data", "axes fraction"), **side)
        step = max(1, -(-len(metric.values) // _TICKS))
        places = range(0, len(metric.values), step)
        axes.set_xticks(places, [printable(history.results[place].called) for place in places])
        axes.set_ylabel(unit)
        sketch.register_axes(axes, f"result {number}", unit)

    name = f"trend-{number}-{history.metrics.index(metric)}"
    return chart.draw(name, title, description, 2.4, paint)


def _series(
    sketch: ChartBuilder,
    axes: Axes,
    history: History,
    metric: MetricHistory,
    environment: int,
    title: str,
    scale: float,
) -> None:
    """Draw the values of an environment, and their means between changes."""
    places = [
        place
        for place, result in enumerate(history.results)
        if result.environment == environment and metric.values[place] is not None
    ]
    if not places:
        return
    values = [(metric.values[place] or 0.0) / scale for place in places]
    ink = chart.colour(environment)
    few = len(metric.values) <= _MAX_MARKED
    style: dict[str, Any] = {"marker": chart.marker(environment), "markersize": 2.5} if few else {}
    (line,) = axes.plot(places, values, color=ink, linewidth=0.7, **style)
    sketch.series(line, title)
    starts = [places.index(one.after) for one in metric.changes if one.after in places]
    for first, end in zip([0, *starts], [*starts, len(places)], strict=True):
        mean = sum(values[first:end]) / (end - first)
        axes.hlines(mean, places[first], places[end - 1], color=ink, linewidth=2, alpha=0.5)


def _breaks(axes: Axes, history: History) -> None:
    """Mark the first result of each further environment."""
    for environment in range(1, len(history.environments)):
        first = history.first_of(environment)
        axes.axvline(first - 0.5, color=PALETTE["quiet"], linestyle=":", linewidth=1)
