"""Charts as inline SVG, with the same settings for all and data for the script of the page.

The library writes ``style`` attributes, which a strict content security policy blocks, and ids that
repeat from one drawing to the next. Here every style becomes presentation attributes, every id gets
the drawing's own prefix, and every colour of the palette also becomes a class, so that a stylesheet
can change it if one is allowed (dark mode).
"""

from __future__ import annotations

import io
import json
import os
import re
import warnings
import xml.etree.ElementTree as ET
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cache
from typing import TYPE_CHECKING, Any, Final

from r2bspec.diagnostics.quote import printable
from r2bspec.report.document import Chart

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.lines import Line2D


PALETTE: Final = {
    "ink": "#1b2330",
    "quiet": "#566070",
    "grid": "#dde3ea",
    "paper": "#ffffff",
    "band": "#eef2f6",
    "bad": "#b3261e",
    "good": "#1b7a3d",
    "unsure": "#8a5a00",
    "s0": "#0b62a8",
    "s1": "#b35500",
    "s2": "#00707a",
    "s3": "#7a3e9d",
    "s4": "#8c6d00",
    "s5": "#a8326b",
}
"""Every colour that a drawing may use, by its name in the stylesheet."""

SERIES: Final = tuple(PALETTE[f"s{number}"] for number in range(6))

_CLASSES = {colour: name for name, colour in PALETTE.items()}
_NUMBER = re.compile(r"-?\d+\.\d+")
_URL_REFERENCE = re.compile(r"url\(#([^)]+)\)")
_FONT = re.compile(r"(?:(?P<weight>bold|\d{3}) )?(?P<size>[\d.]+px) (?P<family>.*)")
_ZERO_ROTATION = re.compile(r"rotate\(-?0(?:\.0*)?[ )]")


def inline(
    svg: str, name: str, title: str, description: str, data: Mapping[str, str], labels: list[str]
) -> str:
    """Return an SVG document as an element of an HTML page.

    Args:
        svg: from the library.
        name: letters, digits and ``-``; unique in the page, put before every id.
        title: of the drawing, for screen readers.
        description: what it shows, likewise.
        data: further attributes of the root, such as ``data-axes``.
        labels: of the series, whose groups have the ids ``series-0``, ``series-1``, ...
    """
    root = ET.fromstring(svg)  # noqa: S314 - written by the plotting library a moment ago
    used: set[str] = set()
    for element in root.iter():
        element.tag = element.tag.rpartition("}")[2]
        _plain_attributes(element, name, used)
    _drop(root, {"style", "metadata"})
    _name_series(root, labels)
    for element in root.iter():
        identity = element.get("id")
        if identity is not None:
            if identity in used:
                element.set("id", f"{name}-{identity}")
            else:
                del element.attrib["id"]
    _set_root(root, name, title, description, data)
    return ET.tostring(root, encoding="unicode")


def _plain_attributes(element: ET.Element, name: str, used: set[str]) -> None:
    style = element.attrib.pop("style", "")
    for declaration in style.split(";"):
        key, _, value = declaration.partition(":")
        _declare(element, key.strip(), value.strip())
    for key in [*element.attrib]:
        value = element.attrib[key]
        if key.endswith("}href"):
            del element.attrib[key]
            key = "href"
        if element.tag == "a" and key == "target":
            del element.attrib[key]
            continue
        # A link leads to what is elsewhere in the page.
        if key == "href" and value.startswith("#") and element.tag != "a":
            used.add(value[1:])
            value = f"#{name}-{value[1:]}"
        elif "url(#" in value:
            used.update(_URL_REFERENCE.findall(value))
            value = _URL_REFERENCE.sub(rf"url(#{name}-\1)", value)
        elif key in {"d", "x", "y", "transform", "points"}:
            if key == "transform" and _ZERO_ROTATION.match(value):
                del element.attrib[key]
                continue
            value = _round_coordinates(value)
        element.set(key, value)
    for key, prefix in (("fill", "f"), ("stroke", "k")):
        known = _CLASSES.get(element.get(key, ""))
        if known is not None:
            before = element.get("class")
            element.set("class", f"{before} {prefix}-{known}" if before else f"{prefix}-{known}")


def _declare(element: ET.Element, key: str, value: str) -> None:
    """One CSS declaration as a presentation attribute; fonts are the page's own."""
    if not key or key in {"font-family", "font-stretch"}:
        return
    if key == "font":
        matched = _FONT.fullmatch(value)
        if matched is not None:
            element.set("font-size", matched["size"])
            if matched["weight"]:
                element.set("font-weight", matched["weight"])
        return
    element.set(key, value)


def _round_coordinates(value: str) -> str:
    """Coordinates to a tenth of a point, on one line."""
    short = _NUMBER.sub(lambda found: f"{float(found[0]):.1f}".removesuffix(".0"), value)
    return " ".join(short.split())


def _drop(element: ET.Element, tags: set[str]) -> None:
    for child in [*element]:
        if child.tag in tags:
            element.remove(child)
        else:
            _drop(child, tags)


def _name_series(root: ET.Element, labels: list[str]) -> None:
    """Groups of series get their labels, for the script."""
    for element in root.iter("g"):
        kind, _, number = element.get("id", "").partition("-")
        if kind == "series" and number.isdecimal():
            element.set("data-label", labels[int(number)])


def _set_root(
    root: ET.Element, name: str, title: str, description: str, data: Mapping[str, str]
) -> None:
    _, _, width, height = root.get("viewBox", "0 0 0 0").split()
    for key in ("version", "xmlns"):
        root.attrib.pop(key, None)
    root.set("id", name)
    # Points to CSS pixels; a stylesheet may fit it to the column.
    root.set("width", f"{float(width) * 4 / 3:.0f}")
    root.set("height", f"{float(height) * 4 / 3:.0f}")
    root.set("font-family", "system-ui, 'DejaVu Sans', sans-serif")
    root.set("stroke-linejoin", "round")
    root.set("class", "chart")
    root.set("role", "img")
    root.set("aria-labelledby", f"{name}-title")
    root.set("aria-describedby", f"{name}-desc")
    for key, value in data.items():
        root.set(key, value)
    desc = ET.Element("desc", {"id": f"{name}-desc"})
    desc.text = description
    root.insert(0, desc)
    heading = ET.Element("title", {"id": f"{name}-title"})
    heading.text = title
    root.insert(0, heading)


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
    scales: list[tuple[Axes, str, str]] = field(default_factory=list)
    note: str = ""

    def series(self, line: Line2D, label: str) -> None:
        """Register a line as a series that the script can show, with this label."""
        line.set_gid(f"series-{len(self.labels)}")
        self.labels.append(printable(label))

    def register_axes(self, axes: Axes, x_unit: str, y_unit: str) -> None:
        """Register axes, so that the script can convert positions to values of these units."""
        self.scales.append((axes, x_unit, y_unit))


def colour(number: int) -> str:
    """Return the colour of a series.

    Colours repeat after six; line styles then tell them apart.
    """
    return SERIES[number % len(SERIES)]


def line_style(number: int) -> Any:
    """Return the line style of a series, which distinguishes it without colour."""
    return _STYLES[number % len(_STYLES)]


def marker(number: int) -> str:
    """Return the marker of a series."""
    return _MARKS[number % len(_MARKS)]


@cache
def _load_matplotlib() -> None:
    """Import it with its own settings; its list of fonts is in the cache of r2bspec.

    It takes the settings of the working directory, which may be a stranger's: they can have texts
    set by LaTeX, with commands of their own. So it is imported in a folder with empty ones.
    """
    from r2bspec.safe_io.cache_folder import cache_or_temporary_folder
    from r2bspec.safe_io.private_files import temporary_folder

    name = "MPLCONFIGDIR"
    before = os.environ.get(name)
    os.environ[name] = str(cache_or_temporary_folder("matplotlib"))
    here = os.open(".", os.O_PATH)
    try:
        with temporary_folder("settings") as folder:
            (folder / "matplotlibrc").touch()
            os.chdir(folder)
            import matplotlib.figure  # noqa: F401
    finally:
        os.fchdir(here)
        os.close(here)
        del os.environ[name]
        if before is not None:
            os.environ[name] = before


def draw(
    name: str,
    title: str,
    description: str,
    height_in: float,
    paint: Callable[[ChartBuilder], object],
) -> Chart:
    """Draw a chart: `paint` gets an empty figure and fills it."""
    _load_matplotlib()
    import matplotlib
    from matplotlib.backends.backend_svg import FigureCanvasSVG
    from matplotlib.figure import Figure

    with matplotlib.rc_context(_SETTINGS), warnings.catch_warnings():
        # The browser draws glyphs for which the library has no metrics.
        warnings.filterwarnings("ignore", message="Glyph .* missing from")
        sketch = ChartBuilder(Figure(figsize=(WIDTH_IN, height_in)))
        paint(sketch)
        buffer = io.StringIO()
        metadata = dict.fromkeys(("Creator", "Date", "Format", "Type"))
        # Not `savefig`, which draws everything twice to lay it out.
        if (engine := sketch.figure.get_layout_engine()) is not None:
            engine.execute(sketch.figure)
            sketch.figure.set_layout_engine("none")
        canvas: Any = FigureCanvasSVG(sketch.figure)
        canvas.print_svg(buffer, metadata=metadata)
        axes = [_scale(axes, height_in, *units) for axes, *units in sketch.scales]
    title, description = printable(title), printable(description)
    data = {"data-axes": json.dumps(axes, separators=(",", ":"))}
    svg = inline(buffer.getvalue(), name, title, description, data, sketch.labels)
    return Chart(name, title, svg, description, printable(sketch.note))


def _scale(axes: Axes, height_in: float, x_unit: str, y_unit: str) -> dict[str, Any]:
    """Return the position of the axes, in points, and the values of their ends."""
    box = axes.get_position()
    wide, high = WIDTH_IN * _POINTS_PER_INCH, height_in * _POINTS_PER_INCH
    return {
        "box": [
            round(pixel, 1)
            for pixel in (box.x0 * wide, (1 - box.y1) * high, box.x1 * wide, (1 - box.y0) * high)
        ],
        "x": [*map(float, axes.get_xlim()), axes.get_xscale(), x_unit],
        "y": [*map(float, axes.get_ylim()), axes.get_yscale(), y_unit],
    }


_EDGE: Final = 0.16
"""The share of the axes next to an edge in which a label would not fit on the side of the edge."""


def write(
    axes: Axes,
    text: str,
    at: tuple[float, float],
    offset: tuple[float, float],
    ink: str,
    **style: Any,
) -> None:
    """Write a text beside a point; `offset` is in points, `style` as matplotlib has it."""
    style = {"fontsize": 8, "textcoords": "offset points", "xytext": offset, **style}
    axes.annotate(text, at, color=ink, **style)


def inside_label(
    axes: Axes, x: float, y: float, text: str, ink: str, *, above: bool = True
) -> None:
    """Write a label beside a point, inside the axes.

    The limits of the axes must be final. `above` is the side where both are possible.
    """
    across, up = axes.transAxes.inverted().transform(axes.transData.transform((x, y)))
    above = up < _EDGE or (above and up < 1 - _EDGE)
    side = "left" if across < 2 * _EDGE else "right" if across > 1 - 2 * _EDGE else "center"
    vertical = "bottom" if above else "top"
    write(axes, text, (x, y), (0, 3 if above else -4), ink, ha=side, va=vertical)


OUTCOME_COLOURS: Final = {"pass": "good", "fail": "bad", "inconclusive": "unsure"}


def scale_values(axes: Axes, *, logarithmic: bool) -> None:
    """Give the vertical axis a logarithmic scale, or a scale from 0."""
    if logarithmic:
        axes.set_yscale("log")
        plain_numbers(axes.yaxis)
    else:
        axes.set_ylim(bottom=0)


def plain_numbers(axis: Any) -> None:
    """Write the ticks of a logarithmic axis as numbers, without powers."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    axis.set_major_locator(LogLocator(base=10, subs=(1, 2, 5)))
    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:,.6g}"))
    axis.set_minor_formatter(NullFormatter())
