"""Charts of histories: a chart for each metric, with the results on the axis.

They are lines alone, so that their paths are written as they are: to have twenty charts drawn by
the library of other charts takes three times as long as to read a thousand results.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Sequence
from typing import Final

from r2bspec.compare.history import History, MetricHistory
from r2bspec.diagnostics.quote import printable
from r2bspec.judge.measure.units import show, significant, unit_scale
from r2bspec.report.document import Chart
from r2bspec.report.html.page import fill_drawing, own_text

_BOX: Final = (80, 8, 798, 204)
"""The axes: left, top, right, bottom."""

_MAX_MARKED: Final = 200
"""Results whose values have marks; of more, a line."""

_TICKS: Final = 8
_INKS: Final = 6
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
    known = [value for value in metric.values if value is not None]
    unit = show(max(map(abs, known)), metric.unit).partition(" ")[2]
    scale = unit_scale(metric.unit, unit)
    values = [None if value is None else value / scale for value in metric.values]
    low, high = min(known) / scale, max(known) / scale
    most = max(map(abs, known)) / scale
    # Where all are the same but for rounding, room around the value.
    spread = next(one for one in (high - low, most, 1.0) if one > max(1e-9 * most, 1e-99))
    low, high = max(low - spread / 4, min(low, 0.0)), high + spread / 4
    left, top, right, bottom = _BOX

    def x(place: float) -> float:
        return round(left + (place + 1) / (len(values) + 1) * (right - left), 1)

    def y(value: float) -> float:
        return round(bottom - (value - low) / (high - low) * (bottom - top), 1)

    def series(environment: int) -> Iterator[dict[str, str]]:
        """Yield the values of an environment, and their means between changes."""
        shown = {
            place: value
            for place, (value, result) in enumerate(zip(values, history.results, strict=True))
            if value is not None and result.environment == environment
        }
        if not shown:
            return
        points = [f"{x(place)} {y(value)}" for place, value in shown.items()]
        places = [*shown]
        starts = [places.index(one.after) for one in metric.changes if one.after in shown]
        stretches = [
            places[first:end]
            for first, end in zip([0, *starts], [*starts, len(places)], strict=True)
        ]
        means = [
            (one[0], sum(shown[place] for place in one) / len(one), one[-1]) for one in stretches
        ]
        yield {
            "ink": f"s{environment % _INKS}",
            "line": f"M{'L'.join(points)}",
            "marks": "".join(f"M{one}h0" for one in points) if len(values) <= _MAX_MARKED else "",
            "shape": ("round", "square")[environment % 2],
            "means": "".join(f"M{x(first)} {y(mean)}H{x(last)}" for first, mean, last in means),
        }

    environments = range(len(history.environments))
    every = max(1, -(-len(values) // _TICKS))
    axes = {
        "box": _BOX,
        "x": [-1, len(values), "linear", f"result {number}"],
        "y": [low, high, "linear", unit],
    }
    name = f"trend-{number}-{history.metrics.index(metric)}"
    title = printable(title)
    description = f"{title} of {len(values)} results, in the order of time."
    svg = fill_drawing(
        "trend.svg.j2",
        name=name,
        title=title,
        description=description,
        box=_BOX,
        axes=json.dumps([axes], separators=(",", ":")),
        values=[
            (y(value), f"{significant(value, 6)} {unit}") for value in _round_values(low, high)
        ],
        results=[
            (x(place), printable(history.results[place].called))
            for place in range(0, len(values), every)
        ],
        breaks=[x(history.first_of(environment) - 0.5) for environment in environments[1:]],
        series=[one for environment in environments for one in series(environment)],
        changes=[
            {
                "x": x(change.after - 0.5),
                "ink": _COLOURS[change.outcome],
                "is_late": change.after > len(values) / 2,
                "label": printable(label),
            }
            for change, label in zip(metric.changes, labels, strict=True)
        ],
    )
    return Chart(name, title, svg, description)


def _round_values(low: float, high: float) -> Iterator[float]:
    """Yield two to six round values between two others."""
    least = (high - low) / 5
    size = 10.0 ** math.floor(math.log10(least))
    step = next(size * factor for factor in (1, 2, 5, 10) if size * factor >= least)
    for number in range(math.ceil(low / step), math.floor(high / step) + 1):
        yield number * step
