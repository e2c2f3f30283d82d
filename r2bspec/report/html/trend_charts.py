"""Charts of histories: a chart for each metric, with the results on the axis."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from typing import Final

from r2bspec.compare.history import History, MetricHistory
from r2bspec.diagnostics.quote import printable
from r2bspec.judge.measure.units import show, unit_scale
from r2bspec.report.document import Chart
from r2bspec.report.html.chart import Axis, Label, Panel, Series, Strokes, draw, ink
from r2bspec.report.html.template import own_text

_MAX_MARKED: Final = 200
"""Results whose values have marks; of more, a line."""

_TICKS: Final = 8
_INKS: Final = {"worse": "bad", "improved": "good"}


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
        number: the number of the history in the page.
        history: the history of the metric.
        metric: with at least one value.
        title: the title of the chart.
        labels: a few words for each change of the metric.
    """
    values = [value for value in metric.values if value is not None]
    unit = show(max(map(abs, values)), metric.unit).partition(" ")[2]
    scale = unit_scale(metric.unit, unit)
    low, high = min(values) / scale, max(values) / scale
    most = max(map(abs, values)) / scale
    # Where all are the same but for rounding, room around the value.
    spread = next(one for one in (high - low, most, 1.0) if one > max(1e-9 * most, 1e-99))
    low, high = max(low - spread / 4, min(low, 0.0)), high + spread / 4
    count = len(metric.values)
    marks: list[Series | Strokes | Label] = []
    for index in range(len(history.environments)):
        marks += _environment(history, metric, index, title, scale)
        if index:
            place = history.first_of(index) - 0.5
            marks.append(Strokes([((place, low), (place, high))], "quiet", dashes="1 2"))
    for change, label in zip(metric.changes, labels, strict=True):
        place, colour = change.after - 0.5, _INKS[change.outcome]
        marks.append(Strokes([((place, low), (place, high))], colour))
        marks.append(Label(label, place, high, colour))
    places = range(0, count, max(1, -(-count // _TICKS)))
    ticks = [(float(place), printable(history.results[place].called)) for place in places]
    panel = Panel(
        Axis("", f"result {number}", -1, count, ticks=ticks),
        Axis(unit, unit, low, high),
        marks,
        196,
    )
    name = f"trend-{number}-{history.metrics.index(metric)}"
    return draw(name, title, f"{title} of {count} results, in the order of time.", [panel])


def _environment(
    history: History, metric: MetricHistory, environment: int, title: str, scale: float
) -> Iterator[Series | Strokes]:
    """Yield the values of an environment, and their means between changes."""
    shown = {
        place: value / scale
        for place, (value, result) in enumerate(zip(metric.values, history.results, strict=True))
        if value is not None and result.environment == environment
    }
    if not shown:
        return
    mark = "dot" if len(metric.values) <= _MAX_MARKED else ""
    yield Series([*shown.items()], title, ink(environment), mark=mark)
    places = [*shown]
    starts = [places.index(one.after) for one in metric.changes if one.after in shown]
    means = []
    for first, end in zip([0, *starts], [*starts, len(places)], strict=True):
        stretch = places[first:end]
        mean = sum(shown[place] for place in stretch) / len(stretch)
        means.append(((stretch[0], mean), (stretch[-1], mean)))
    yield Strokes(means, "ink", 2, opacity=0.6)
