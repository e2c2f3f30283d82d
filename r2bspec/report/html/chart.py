"""Charts as inline SVG: panels one below the other, each with two axes and marks.

Marks have the values of the axes as coordinates. Labelled series are what the script of the page
shows at the pointer.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Final

from r2bspec.diagnostics.quote import printable
from r2bspec.report.document import Chart
from r2bspec.report.html.template import fill

SERIES_INKS: Final = ("s0", "s1", "s2", "s3", "s4", "s5")
OUTCOME_INKS: Final = {"pass": "good", "fail": "bad", "inconclusive": "unsure"}

_DASHES: Final = ("", "6 3", "8 3 2 3", "2 3", "12 4", "1 2")
_SHAPES: Final = {
    "dot": "h0",
    "circle": "m-3 0a3 3 0 1 0 6 0a3 3 0 1 0-6 0",
    "cross": "m-3-3l6 6m0-6l-6 6",
    "diamond": "m0-4l4 4l-4 4l-4-4z",
    "triangle": "m0-4l4 7h-8z",
}
"""Marks as paths, relative to their points."""

_WIDTH: Final = 812
_LEFT: Final = 72
_RIGHT: Final = 800
_LINE: Final = 16
_CHARACTER: Final = 6.8
"""The usual width of a character of a legend; texts are drawn by the browser."""

_EDGE: Final = 0.16
"""The share of an axis next to its end in which a label would not fit on the side of the end."""

_MAX_LOG_TICKS: Final = 8


def ink(number: int) -> str:
    """Return the colour of a series; colours repeat after six, and dashes tell series apart."""
    return SERIES_INKS[number % len(SERIES_INKS)]


def dashes(number: int) -> str:
    """Return the dashes of the line of a series, which distinguish it without colour."""
    return _DASHES[number % len(_DASHES)]


@dataclass(frozen=True, slots=True)
class Axis:
    """An axis.

    Attributes:
        title: the text beside the axis; empty for none.
        unit: the unit of its values, for the script.
        low: the value at its left or lower end.
        high: the value at the other end.
        ticks: values with their texts; round values if empty.
    """

    title: str
    unit: str
    low: float
    high: float
    logarithmic: bool = False
    ticks: Sequence[tuple[float, str]] = ()

    def share(self, value: float) -> float:
        """Return the place of a value: 0 at the low end, 1 at the high end, and never beyond."""
        low, high = self.low, self.high
        if self.logarithmic:
            low, high, value = math.log(low), math.log(high), math.log(max(value, low))
        return min(max((value - low) / (high - low), 0.0), 1.0)

    def all_ticks(self) -> Iterator[tuple[float, str]]:
        """Yield the ticks within the axis, with their texts."""
        for value, text in self.ticks or ((value, f"{value:,.6g}") for value in self._round()):
            if self.low <= value <= self.high:
                yield value, text

    def _round(self) -> list[float]:
        """Return two to eight round values."""
        if self.logarithmic:
            first, last = (math.floor(math.log10(end)) for end in (self.low, self.high))
            decades = [10.0**power for power in range(first, last + 1)]
            values = [decade * factor for decade in decades for factor in (1, 2, 5)]
            inside = [value for value in values if self.low <= value <= self.high]
            return inside if len(inside) <= _MAX_LOG_TICKS else decades
        least = (self.high - self.low) / 5
        size = 10.0 ** math.floor(math.log10(least))
        step = next(size * factor for factor in (1, 2, 5, 10) if size * factor >= least)
        numbers = range(math.ceil(self.low / step), math.floor(self.high / step) + 1)
        return [number * step for number in numbers]


def value_axis(
    title: str, unit: str, values: Sequence[float], *, logarithmic: bool = False
) -> Axis:
    """Return the axis of values of 0 and more, which begins at 0 unless it is logarithmic."""
    known = [value for value in values if math.isfinite(value) and (value > 0 or not logarithmic)]
    high = max(known, default=0.0) or 1.0
    low = min(known, default=high) / 1.2 if logarithmic else 0.0
    return Axis(title, unit, low, high * (1.2 if logarithmic else 1.08), logarithmic)


Point = tuple[float, float]


@dataclass(frozen=True, slots=True)
class Series:
    """Points that the script shows, as a line, as marks, or as both.

    Attributes:
        label: what the script calls them.
        legend: what the legend calls them; empty if it leaves them out.
        mark: the mark of each point, one of `_SHAPES`; empty for none.
        filled: whether marks are filled.
    """

    points: Sequence[Point]
    label: str
    ink: str
    legend: str = ""
    joined: bool = True
    dashes: str = ""
    mark: str = ""
    filled: bool = True
    width: float = 1.6


@dataclass(frozen=True, slots=True)
class Strokes:
    """Straight lines from one point to another: limits, ranges, separators."""

    lines: Sequence[tuple[Point, Point]]
    ink: str
    width: float = 1.0
    dashes: str = ""
    opacity: float = 1.0


@dataclass(frozen=True, slots=True)
class Band:
    """The whole height of a panel between two values of its horizontal axis."""

    first: float
    last: float
    ink: str = "band"
    opacity: float = 1.0


@dataclass(frozen=True, slots=True)
class Label:
    """A text beside a point, within the axes: above it if `above`, unless that does not fit."""

    text: str
    x: float
    y: float
    ink: str = "ink"
    above: bool = True


@dataclass(frozen=True, slots=True)
class Panel:
    """Two axes with their marks; `left` and `right` stand above them."""

    x: Axis
    y: Axis
    marks: Sequence[Series | Strokes | Band | Label]
    height: int
    left: str = ""
    right: str = ""
    title_ink: str = "quiet"


@dataclass(frozen=True, slots=True)
class _Stroke:
    path: str
    ink: str
    width: float = 1.0
    dashes: str = ""
    cap: str = ""
    opacity: float = 1.0
    fill: str = ""
    label: str = ""


@dataclass(frozen=True, slots=True)
class _Text:
    text: str
    x: float
    y: float
    ink: str = "ink"
    anchor: str = "start"
    turned: bool = False


@dataclass
class _Drawing:
    """What a drawing consists of, in pixels, from top to bottom."""

    strokes: list[_Stroke] = field(default_factory=list)
    texts: list[_Text] = field(default_factory=list)
    axes: list[dict[str, object]] = field(default_factory=list)
    bottom: float = 4

    def add_legend(self, panels: Sequence[Panel]) -> None:
        listed = {
            mark.legend: mark
            for panel in panels
            for mark in panel.marks
            if isinstance(mark, Series) and mark.legend
        }
        x, y = float(_LEFT), self.bottom + 10
        for name, mark in listed.items():
            wide = 32 + len(name) * _CHARACTER
            if x > _LEFT and x + wide > _RIGHT:
                x, y = float(_LEFT), y + _LINE
            if mark.joined:
                path = f"M{x} {y - 4}h18"
                self.strokes.append(_Stroke(path, mark.ink, mark.width, mark.dashes))
            self._add_marks(mark, [f"{x + 9} {y - 4}"])
            self.texts.append(_Text(name, x + 23, y))
            x += wide + 8
        if listed:
            self.bottom = y + 8

    def add_panel(self, panel: Panel) -> None:
        top = self.bottom + (_LINE + 2 if panel.left or panel.right else 6)
        bottom = top + panel.height

        def x(value: float) -> float:
            return round(_LEFT + panel.x.share(value) * (_RIGHT - _LEFT), 1)

        def y(value: float) -> float:
            return round(bottom - panel.y.share(value) * panel.height, 1)

        for mark in panel.marks:
            if isinstance(mark, Band):
                first, last = x(mark.first), x(mark.last)
                path = f"M{first} {top}H{last}V{bottom}H{first}z"
                self.strokes.append(_Stroke(path, mark.ink, 0, opacity=mark.opacity, fill=mark.ink))
        for value, text in panel.y.all_ticks():
            self.strokes.append(_Stroke(f"M{_LEFT} {y(value)}H{_RIGHT}", "grid"))
            self.texts.append(_Text(text, _LEFT - 6, y(value) + 4, anchor="end"))
        ticks = [(x(value), text) for value, text in panel.x.all_ticks()]
        frame = f"M{_LEFT} {top}V{bottom}H{_RIGHT}"
        frame += "".join(f"M{place} {bottom}v4" for place, _ in ticks)
        self.strokes.append(_Stroke(frame, "quiet"))
        self.texts += [_Text(text, at, bottom + _LINE, anchor="middle") for at, text in ticks]
        for mark in panel.marks:
            if isinstance(mark, Series):
                points = [f"{x(across)} {y(up)}" for across, up in mark.points]
                line = f"M{'L'.join(points)}" if points else ""
                stroke = mark.ink if mark.joined else ""
                label = printable(mark.label)
                self.strokes.append(_Stroke(line, stroke, mark.width, mark.dashes, label=label))
                self._add_marks(mark, points)
            elif isinstance(mark, Strokes):
                path = "".join(f"M{x(a)} {y(b)}L{x(c)} {y(d)}" for (a, b), (c, d) in mark.lines)
                stroke_of = (mark.ink, mark.width, mark.dashes)
                self.strokes.append(_Stroke(path, *stroke_of, opacity=mark.opacity))
            elif isinstance(mark, Label):
                self._add_label(panel, mark, x(mark.x), y(mark.y))
        self._add_titles(panel, top, bottom)
        self.axes.append(
            {
                "box": [_LEFT, top, _RIGHT, bottom],
                **{
                    key: [axis.low, axis.high, "log" if axis.logarithmic else "linear", axis.unit]
                    for key, axis in (("x", panel.x), ("y", panel.y))
                },
            }
        )
        self.bottom = bottom + _LINE + 4 + (_LINE if panel.x.title else 0)

    def _add_marks(self, mark: Series, points: Sequence[str]) -> None:
        if mark.mark:
            shape = _SHAPES[mark.mark]
            dot = mark.mark == "dot"
            fill = mark.ink if mark.filled and not dot else ""
            path = "".join(f"M{point}{shape}" for point in points)
            width, cap = (3.5, "round") if dot else (1.4, "")
            self.strokes.append(_Stroke(path, mark.ink, width, cap=cap, fill=fill))

    def _add_label(self, panel: Panel, mark: Label, x: float, y: float) -> None:
        across, up = panel.x.share(mark.x), panel.y.share(mark.y)
        above = up < _EDGE or (mark.above and up < 1 - _EDGE)
        anchor = "start" if across < 2 * _EDGE else "end" if across > 1 - 2 * _EDGE else "middle"
        at = y - 5 if above else y + 14
        self.texts.append(_Text(printable(mark.text), x, at, mark.ink, anchor))

    def _add_titles(self, panel: Panel, top: float, bottom: float) -> None:
        middle = (top + bottom) / 2
        self.texts.append(_Text(panel.y.title, 14, middle, "quiet", "middle", turned=True))
        at = (_LEFT + _RIGHT) / 2, bottom + 2 * _LINE + 1
        if panel.x.title:
            self.texts.append(_Text(panel.x.title, *at, "quiet", "middle"))
        for text, x, anchor in ((panel.left, _LEFT, "start"), (panel.right, _RIGHT, "end")):
            if text:
                self.texts.append(_Text(printable(text), x, top - 6, panel.title_ink, anchor))


def draw(name: str, title: str, description: str, panels: Sequence[Panel], note: str = "") -> Chart:
    """Return a chart of panels, one below the other, with a legend above them.

    Args:
        name: letters, digits and ``-``; unique in the page.
        title: the title of the chart.
        description: the description of its content, for readers who do not see it.
        panels: from top to bottom.
        note: see `Chart`.
    """
    drawing = _Drawing()
    drawing.add_legend(panels)
    for panel in panels:
        drawing.add_panel(panel)
    title, description = printable(title), printable(description)
    svg = fill(
        "chart.svg.j2",
        name=name,
        title=title,
        description=description,
        width=_WIDTH,
        height=round(drawing.bottom),
        axes=json.dumps(drawing.axes, separators=(",", ":")),
        strokes=drawing.strokes,
        texts=drawing.texts,
    )
    return Chart(name, title, svg, description, printable(note))
