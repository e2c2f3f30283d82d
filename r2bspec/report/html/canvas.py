"""A chart: the plotting library with the same settings for all, and data for the script."""

from __future__ import annotations

import io
import json
import warnings
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Final

from r2bspec.diagnostics.quote import printable
from r2bspec.report.html.svg import PALETTE, SERIES, inline

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.lines import Line2D

WIDTH_IN: Final = 8.4
_POINTS_PER_INCH: Final = 72

_SETTINGS: Final[dict[Any, Any]] = {
    "svg.fonttype": "none",
    "svg.hashsalt": "r2bspec",
    "text.parse_math": False,
    "axes.formatter.use_mathtext": False,
    "font.family": "sans-serif",
    "font.sans-serif": ["DejaVu Sans"],
    "font.size": 9,
    "text.color": PALETTE["ink"],
    "axes.labelcolor": PALETTE["quiet"],
    "axes.edgecolor": PALETTE["quiet"],
    "axes.facecolor": "none",
    "axes.linewidth": 0.7,
    "axes.grid": True,
    "axes.axisbelow": True,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "grid.color": PALETTE["grid"],
    "grid.linewidth": 0.6,
    "xtick.color": PALETTE["quiet"],
    "ytick.color": PALETTE["quiet"],
    "xtick.labelcolor": PALETTE["ink"],
    "ytick.labelcolor": PALETTE["ink"],
    "xtick.minor.size": 0,
    "ytick.minor.size": 0,
    "legend.frameon": False,
    "legend.fontsize": 9,
    "lines.linewidth": 1.6,
    "lines.markersize": 4,
    "figure.facecolor": "none",
    "savefig.facecolor": "none",
    "figure.constrained_layout.use": True,
}

_STYLES: Final = ("-", "--", "-.", ":", (0, (5, 1)), (0, (1, 1)))
_MARKS: Final = ("o", "s", "^", "D", "v", "P")


@dataclass(frozen=True)
class Chart:
    """A finished chart.

    Attributes:
        name: unique in the page.
        title: the heading of the figure.
        description: of the content, in words.
        svg: the drawing itself.
        note: what is omitted, or how to read it; may be empty.
    """

    name: str
    title: str
    description: str
    svg: str
    note: str = ""


@dataclass
class ChartBuilder:
    """A chart that is being drawn.

    Attributes:
        figure: to draw on.
        labels: of the series so far.
        note: see `Chart`.
    """

    figure: Figure
    labels: list[str] = field(default_factory=list)
    scales: dict[int, tuple[Axes, str, str]] = field(default_factory=dict)
    note: str = ""

    def series(self, line: Line2D, label: str) -> None:
        """Register a line as a series that the script can show, with this label."""
        line.set_gid(f"series-{len(self.labels)}")
        self.labels.append(printable(label))

    def register_axes(self, axes: Axes, x_unit: str, y_unit: str) -> None:
        """Register axes, so that the script can convert positions to values of these units."""
        self.scales[len(self.scales)] = (axes, x_unit, y_unit)


def colour(number: int) -> str:
    """The colour of a series; they repeat after six, and line styles tell them apart, too."""
    return SERIES[number % len(SERIES)]


def line_style(number: int) -> Any:
    """The line style of a series, to distinguish it not by colour alone."""
    return _STYLES[number % len(_STYLES)]


def marker(number: int) -> str:
    """The marker of a series."""
    return _MARKS[number % len(_MARKS)]


def draw(
    name: str,
    title: str,
    description: str,
    height_in: float,
    paint: Callable[[ChartBuilder], object],
) -> Chart:
    """Draw a chart: `paint` gets an empty figure and fills it."""
    import matplotlib
    from matplotlib.figure import Figure

    with matplotlib.rc_context(_SETTINGS), warnings.catch_warnings():
        # The browser draws glyphs for which the library has no metrics.
        warnings.filterwarnings("ignore", message="Glyph .* missing from")
        sketch = ChartBuilder(Figure(figsize=(WIDTH_IN, height_in)))
        paint(sketch)
        buffer = io.StringIO()
        metadata = dict.fromkeys(("Creator", "Date", "Format", "Type"))
        sketch.figure.savefig(buffer, format="svg", metadata=metadata)
        axes = [
            _scale(axes, height_in, x_unit, y_unit)
            for axes, x_unit, y_unit in sketch.scales.values()
        ]
    title, description = printable(title), printable(description)
    data = {"data-axes": json.dumps(axes, separators=(",", ":"))}
    svg = inline(buffer.getvalue(), name, title, description, data, sketch.labels)
    return Chart(name, title, description, svg, printable(sketch.note))


def _scale(axes: Axes, height_in: float, x_unit: str, y_unit: str) -> dict[str, Any]:
    """The position of the axes, in points, and the values of their ends."""
    box = axes.get_position()
    wide, high = WIDTH_IN * _POINTS_PER_INCH, height_in * _POINTS_PER_INCH
    return {
        "box": [
            round(each, 1)
            for each in (box.x0 * wide, (1 - box.y1) * high, box.x1 * wide, (1 - box.y0) * high)
        ],
        "x": [*map(float, axes.get_xlim()), axes.get_xscale(), x_unit],
        "y": [*map(float, axes.get_ylim()), axes.get_yscale(), y_unit],
    }


_EDGE: Final = 0.16
"""The share of the axes next to an edge in which a label would not fit on the side of the edge."""


def inside_label(
    axes: Axes, x: float, y: float, text: str, ink: str, *, above: bool = True
) -> None:
    """Write a label next to a point, on a side on which it is inside the axes.

    The limits of the axes must be final. `above` is the side where both are possible.
    """
    across, up = axes.transAxes.inverted().transform(axes.transData.transform((x, y)))
    above = up < _EDGE or (above and up < 1 - _EDGE)
    side = "left" if across < 2 * _EDGE else "right" if across > 1 - 2 * _EDGE else "center"
    axes.annotate(
        text,
        (x, y),
        xytext=(0, 3 if above else -4),
        textcoords="offset points",
        ha=side,
        va="bottom" if above else "top",
        fontsize=8,
        color=ink,
    )


OUTCOME_COLOURS: Final = {"pass": "good", "fail": "bad", "inconclusive": "unsure"}


def plain_numbers(axis: Any) -> None:
    """Write the ticks of a logarithmic axis as numbers, without powers."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    axis.set_major_locator(LogLocator(base=10, subs=(1, 2, 5)))
    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:,.6g}"))
    axis.set_minor_formatter(NullFormatter())
