"""The graph of the plan, laid out in layers from the player to the monitors.

Boxes are placed by the longest way that leads to them, and ordered within a layer by the places of
what they are fed from, which keeps most arrows from crossing.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from r2bspec.diagnostics.quote import clip
from r2bspec.plan.figure import Arrow, Box, BoxKind, figure
from r2bspec.plan.plan import Plan

_CHARACTER = 7.4
"""Width of a character at the size that the boxes are lettered in."""

_LONGEST = 34
_LINE = 15
_PAD = 8
_COLUMN_GAP = 34
_ROW_GAP = 14
_TITLE = 26


@dataclass(frozen=True)
class Line:
    """A line of text in a box; `full` is what was cut off for the drawing."""

    text: str
    x: float
    y: float
    weight: str
    kind: str


@dataclass(frozen=True)
class Drawn:
    """A box with its place, in pixels."""

    kind: BoxKind
    x: float
    y: float
    width: float
    height: float
    lines: tuple[Line, ...]
    title: str


@dataclass(frozen=True)
class Way:
    """An arrow from one box to the next, as an SVG path."""

    path: str
    stored: bool


@dataclass(frozen=True)
class Frame:
    """The boxes of one phase, with its name."""

    title: str
    x: float
    y: float
    width: float
    height: float


@dataclass(frozen=True)
class Drawing:
    """Everything that the page's template needs to write the SVG."""

    width: float
    height: float
    frames: tuple[Frame, ...]
    boxes: tuple[Drawn, ...]
    ways: tuple[Way, ...]
    description: str


def lay_out(plan: Plan, told: Mapping[str, Sequence[str]]) -> Drawing:
    """Place everything.

    Args:
        plan: the plan to draw.
        told: lines to add below the name of a box, by that name.
    """
    sketch = figure(plan)
    y, widest = 2.0, 0.0
    frames: list[Frame] = []
    placed: dict[str, Drawn] = {}
    groups = [("", sketch.boxes), *((group.title, group.boxes) for group in sketch.groups)]
    for title, boxes in groups:
        if not boxes:
            continue
        top = y + (_TITLE if title else 0)
        found = _layers(boxes, sketch.arrows, told, _PAD, top)
        placed |= found
        right = max(one.x + one.width for one in found.values()) + _PAD
        bottom = max(one.y + one.height for one in found.values()) + _PAD
        if title:
            frames.append(Frame(title, 0, y, right, bottom - y))
        widest = max(widest, right)
        y = bottom + _ROW_GAP
    ways = tuple(_way(placed[each.tail], placed[each.head], each.stored) for each in sketch.arrows)
    return Drawing(
        width=widest + 2,
        height=y,
        frames=tuple(frames),
        boxes=tuple(placed.values()),
        ways=ways,
        description=_in_words(sketch.arrows, placed),
    )


def _layers(
    boxes: Sequence[Box],
    arrows: Sequence[Arrow],
    told: Mapping[str, Sequence[str]],
    left: float,
    top: float,
) -> dict[str, Drawn]:
    known = {box.id: box for box in boxes}
    feeds = [(a.tail, a.head) for a in arrows if a.tail in known and a.head in known]
    layer = _ranks([*known], feeds)
    placed: dict[str, Drawn] = {}
    x = left
    for number in range(max(layer.values()) + 1):
        column = [box for box in boxes if layer[box.id] == number]
        column.sort(key=lambda box: _height_of_feeders(box.id, feeds, placed))
        shown = [_lines(box, told.get(box.lines[0], ())) for box in column]
        width = max(len(text) for lines in shown for text in lines) * _CHARACTER + 2 * _PAD
        y = top
        for box, lines in zip(column, shown, strict=True):
            placed[box.id] = _drawn(box, lines, x, y, width)
            y += placed[box.id].height + _ROW_GAP
        x += width + _COLUMN_GAP
    return placed


def _ranks(names: list[str], feeds: list[tuple[str, str]]) -> dict[str, int]:
    """The layer of each box; members of a circle share the layer at which it is entered."""
    import networkx as nx

    graph: nx.DiGraph[str] = nx.DiGraph()
    graph.add_nodes_from(names)
    graph.add_edges_from(feeds)
    circles = nx.condensation(graph)
    rank: dict[int, int] = {}
    for circle in nx.topological_sort(circles):
        rank[circle] = max((rank[each] + 1 for each in circles.predecessors(circle)), default=0)
    return {name: rank[circles.graph["mapping"][name]] for name in names}


def _height_of_feeders(name: str, feeds: list[tuple[str, str]], placed: dict[str, Drawn]) -> float:
    heights = [placed[tail].y for tail, head in feeds if head == name and tail in placed]
    return sum(heights) / len(heights) if heights else 0.0


def _lines(box: Box, told: Sequence[str]) -> list[str]:
    return [clip(line, _LONGEST) for line in (*box.lines, *told) if line]


def _drawn(box: Box, lines: list[str], x: float, y: float, width: float) -> Drawn:
    named = sum(bool(line) for line in box.lines)
    return Drawn(
        kind=box.kind,
        x=x,
        y=y,
        width=width,
        height=len(lines) * _LINE + _PAD,
        lines=tuple(
            Line(
                text,
                x + _PAD,
                y + _LINE * (number + 1) - 1,
                "bold" if number == 0 and box.kind != "topic" else "normal",
                "ink" if number == 0 or number >= named else "quiet",
            )
            for number, text in enumerate(lines)
        ),
        title=" · ".join(line for line in box.lines if line),
    )


def _way(tail: Drawn, head: Drawn, stored: bool) -> Way:
    """Out of the right side and into the left one; down and around if that is behind."""
    x0, y0 = tail.x + tail.width, tail.y + tail.height / 2
    x1, y1 = head.x, head.y + head.height / 2
    if x1 > x0:
        bend = (x1 - x0) / 2
        path = (
            f"M{x0:.0f} {y0:.0f}C{x0 + bend:.0f} {y0:.0f} {x1 - bend:.0f} {y1:.0f} "
            f"{x1:.0f} {y1:.0f}"
        )
    else:
        x0, y0 = tail.x + tail.width / 2, tail.y + tail.height
        x1, y1 = head.x + head.width / 2, head.y
        if y1 <= y0:  # back within a frame
            y1 = head.y + head.height
            low = max(y0, y1) + 2 * _ROW_GAP
            path = f"M{x0:.0f} {y0:.0f}C{x0:.0f} {low:.0f} {x1:.0f} {low:.0f} {x1:.0f} {y1:.0f}"
        else:
            middle = (y0 + y1) / 2
            path = (
                f"M{x0:.0f} {y0:.0f}C{x0:.0f} {middle:.0f} {x1:.0f} {middle:.0f} {x1:.0f} {y1:.0f}"
            )
    return Way(path, stored)


def _in_words(arrows: Sequence[Arrow], placed: Mapping[str, Drawn]) -> str:
    said = [f"{placed[a.tail].title} to {placed[a.head].title}" for a in arrows]
    return "Messages go from " + "; from ".join(said) + "." if said else "Nothing is connected."
