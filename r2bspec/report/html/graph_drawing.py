"""The graph of the plan, laid out in layers from the player to the monitors.

Boxes are placed by the longest path to them, and ordered within a layer by the positions of their
predecessors, which keeps most arrows from crossing.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from r2bspec.diagnostics.quote import clip
from r2bspec.plan.figure import Arrow, Box, BoxKind, figure
from r2bspec.plan.plan import Plan
from r2bspec.report.html.edge_routes import Rectangle, route

_CHARACTER_WIDTH = 7.4
"""Width of a character at the font size of the boxes."""

_MAX_LABEL_CHARACTERS = 34
_LINE_HEIGHT = 15
_PADDING = 8
_COLUMN_GAP = 34
_ROW_GAP = 14
_TITLE_HEIGHT = 26

TITLE_X = 28
"""Where the title of a frame begins: to the right of arrows that come from another frame."""


@dataclass(frozen=True)
class TextLine:
    """A line of text in a box."""

    text: str
    x: float
    y: float
    weight: str
    kind: str


@dataclass(frozen=True)
class PlacedBox:
    """A box with its place, in pixels."""

    kind: BoxKind
    x: float
    y: float
    width: float
    height: float
    lines: tuple[TextLine, ...]
    title: str


@dataclass(frozen=True)
class Edge:
    """An arrow from one box to the next, as an SVG path."""

    path: str
    stored: bool


@dataclass(frozen=True)
class PhaseFrame:
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
    frames: tuple[PhaseFrame, ...]
    boxes: tuple[PlacedBox, ...]
    edges: tuple[Edge, ...]
    description: str


def lay_out(plan: Plan, annotations: Mapping[str, Sequence[str]]) -> Drawing:
    """Place everything.

    Args:
        plan: the plan to draw.
        annotations: lines to add below the name of a box, by that name.
    """
    sketch = figure(plan)
    y, widest = 2.0, 0.0
    frames: list[PhaseFrame] = []
    placed: dict[str, PlacedBox] = {}
    groups = [("", sketch.boxes), *((group.title, group.boxes) for group in sketch.groups)]
    for title, boxes in groups:
        if not boxes:
            continue
        top = y + (_TITLE_HEIGHT if title else 0)
        # Room on the left for arrows that come from another frame.
        found = _layers(boxes, sketch.arrows, annotations, _COLUMN_GAP / 2 + _PADDING, top)
        placed |= found
        right = max(one.x + one.width for one in found.values()) + _COLUMN_GAP / 2 + _PADDING
        bottom = max(one.y + one.height for one in found.values()) + _PADDING
        if title:
            frames.append(PhaseFrame(title, 0, y, right, bottom - y))
        widest = max(widest, right)
        y = bottom + _ROW_GAP
    rectangles = {name: _rectangle(box) for name, box in placed.items()}
    obstacles = [*rectangles.values(), *map(_title_rectangle, frames)]
    edges = tuple(
        Edge(
            route(
                rectangles[each.tail],
                rectangles[each.head],
                obstacles,
                _COLUMN_GAP,
                _ROW_GAP,
            ),
            each.stored,
        )
        for each in sketch.arrows
    )
    return Drawing(
        width=widest + 2,
        height=y,
        frames=tuple(frames),
        boxes=tuple(placed.values()),
        edges=edges,
        description=_description(sketch.arrows, placed),
    )


def _layers(
    boxes: Sequence[Box],
    arrows: Sequence[Arrow],
    annotations: Mapping[str, Sequence[str]],
    left: float,
    top: float,
) -> dict[str, PlacedBox]:
    known = {box.id: box for box in boxes}
    feeds = [(a.tail, a.head) for a in arrows if a.tail in known and a.head in known]
    layer = _layer_indices([*known], feeds)
    placed: dict[str, PlacedBox] = {}
    x = left
    for number in range(max(layer.values()) + 1):
        column = [box for box in boxes if layer[box.id] == number]
        column.sort(key=lambda box: _mean_predecessor_y(box.id, feeds, placed))
        shown = [_lines(box, annotations.get(box.lines[0], ())) for box in column]
        width = (
            max(len(text) for lines in shown for text in lines) * _CHARACTER_WIDTH + 2 * _PADDING
        )
        y = top
        for box, lines in zip(column, shown, strict=True):
            placed[box.id] = _place_box(box, lines, x, y, width)
            y += placed[box.id].height + _ROW_GAP
        x += width + _COLUMN_GAP
    return placed


def _layer_indices(names: list[str], feeds: list[tuple[str, str]]) -> dict[str, int]:
    """The layer of each box; the boxes of a cycle share a layer."""
    import networkx as nx

    graph: nx.DiGraph[str] = nx.DiGraph()
    graph.add_nodes_from(names)
    graph.add_edges_from(feeds)
    components = nx.condensation(graph)
    rank: dict[int, int] = {}
    for component in nx.topological_sort(components):
        rank[component] = max(
            (rank[each] + 1 for each in components.predecessors(component)), default=0
        )
    return {name: rank[components.graph["mapping"][name]] for name in names}


def _mean_predecessor_y(
    name: str, feeds: list[tuple[str, str]], placed: dict[str, PlacedBox]
) -> float:
    heights = [placed[tail].y for tail, head in feeds if head == name and tail in placed]
    return sum(heights) / len(heights) if heights else 0.0


def _lines(box: Box, annotations: Sequence[str]) -> list[str]:
    return [clip(line, _MAX_LABEL_CHARACTERS) for line in (*box.lines, *annotations) if line]


def _place_box(box: Box, lines: list[str], x: float, y: float, width: float) -> PlacedBox:
    named = sum(bool(line) for line in box.lines)
    return PlacedBox(
        kind=box.kind,
        x=x,
        y=y,
        width=width,
        height=len(lines) * _LINE_HEIGHT + _PADDING,
        lines=tuple(
            TextLine(
                text,
                x + _PADDING,
                y + _LINE_HEIGHT * (number + 1) - 1,
                "bold" if number == 0 and box.kind != "topic" else "normal",
                "ink" if number == 0 or number >= named else "quiet",
            )
            for number, text in enumerate(lines)
        ),
        title=" · ".join(line for line in box.lines if line),
    )


def _rectangle(box: PlacedBox) -> Rectangle:
    return Rectangle(box.x, box.y, box.width, box.height)


def _title_rectangle(frame: PhaseFrame) -> Rectangle:
    """The place of a frame's title, from the top of the frame."""
    return Rectangle(TITLE_X, frame.y + 4, len(frame.title) * _CHARACTER_WIDTH, _TITLE_HEIGHT - 10)


def _description(arrows: Sequence[Arrow], placed: Mapping[str, PlacedBox]) -> str:
    texts = [f"{placed[a.tail].title} to {placed[a.head].title}" for a in arrows]
    return (
        "Messages go from " + "; from ".join(texts) + "." if texts else "There are no connections."
    )
