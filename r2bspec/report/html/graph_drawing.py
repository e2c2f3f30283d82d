"""The graph of the plan, laid out in layers from the player to the monitors.

Boxes are placed by the longest path to them, and ordered within a layer by the positions of their
predecessors, which keeps most arrows from crossing.

Arrows go around boxes, never through them. A direct curve is taken where it is free. Otherwise an
arrow leaves its box to the right, goes along a lane between rows of boxes, and enters the next box
from the left. The gaps between columns have room for the vertical parts. Layers that have no room
beside the others begin a new row; an arrow that passes by a whole row does so on the left of it.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from r2bspec.diagnostics.quote import clip
from r2bspec.plan.drawing import PHASES, Box, BoxKind, arrows_of, drawn_graph
from r2bspec.plan.plan import Plan

if TYPE_CHECKING:
    import networkx as nx

_SAMPLES = 40
_CLEARANCE = 3.0

_NEAR_LANES = 4
"""Of each end of an arrow, tried for a way along the left side."""


@dataclass(frozen=True)
class Rectangle:
    """A box, in pixels from the upper left corner of the drawing."""

    x: float
    y: float
    width: float
    height: float

    @property
    def right(self) -> float:
        """The right side."""
        return self.x + self.width

    @property
    def bottom(self) -> float:
        """The lower side."""
        return self.y + self.height

    @property
    def middle_y(self) -> float:
        """The height at which arrows leave and enter."""
        return self.y + self.height / 2

    def contains(self, x: float, y: float) -> bool:
        """Return True if a point is inside, or too close."""
        return (
            self.x - _CLEARANCE < x < self.right + _CLEARANCE
            and self.y - _CLEARANCE < y < self.bottom + _CLEARANCE
        )


Point = tuple[float, float]


def route(
    tail: Rectangle, head: Rectangle, boxes: Iterable[Rectangle], gap: float, row_gap: float
) -> str:
    """Return the path of an arrow as SVG.

    Args:
        tail: where it begins.
        head: where it ends.
        boxes: all boxes of the drawing.
        gap: the room between two columns.
        row_gap: the room between two rows.
    """
    others = [box for box in boxes if box not in (tail, head)]
    start, end = (tail.right, tail.middle_y), (head.x, head.middle_y)
    if end[0] > start[0]:
        curve = list(_curve(start, end))
        if _is_free(curve, others):
            bend = (end[0] - start[0]) / 2
            handles = ((start[0] + bend, start[1]), (end[0] - bend, end[1]))
            return f"{_moves(start)}C" + " ".join(f"{x:.0f} {y:.0f}" for x, y in (*handles, end))
    out_x, in_x = start[0] + gap / 2, end[0] - gap / 2
    candidates = [
        [start, (out_x, start[1]), (out_x, lane), (in_x, lane), (in_x, end[1]), end]
        for lane in _lanes((tail, head, *others), (start[1] + end[1]) / 2, row_gap)
    ]
    obstacles = [*others, tail, head]
    left = min(box.x for box in obstacles) - gap / 2
    by_tail, by_head = (_lanes(obstacles, y, row_gap)[:_NEAR_LANES] for _, y in (start, end))
    candidates += [
        [start, (out_x, start[1]), (out_x, first), (left, first), (left, last), (in_x, last),
         (in_x, end[1]), end]
        for first, last in itertools.product(by_tail, by_head)
    ]  # fmt: skip
    free = (candidate for candidate in candidates if _is_free(_along(candidate[1:-1]), obstacles))
    chosen = next(free, candidates[0])
    return _moves(start) + "".join(f"L{x:.0f} {y:.0f}" for x, y in chosen[1:])


def _lanes(boxes: Sequence[Rectangle], wanted: float, row_gap: float) -> list[float]:
    """Return the heights between rows, those nearest to the direct way first."""
    heights = {box.y - row_gap / 2 for box in boxes}
    heights |= {box.bottom + row_gap / 2 for box in boxes}
    return sorted(heights, key=lambda height: (abs(height - wanted), height))


def _curve(start: Point, end: Point) -> Iterator[Point]:
    """Points on the curve with horizontal ends."""
    bend = (end[0] - start[0]) / 2
    xs = (start[0], start[0] + bend, end[0] - bend, end[0])
    ys = (start[1], start[1], end[1], end[1])
    for number in range(1, _SAMPLES):
        t = number / _SAMPLES
        weights = ((1 - t) ** 3, 3 * t * (1 - t) ** 2, 3 * t * t * (1 - t), t**3)
        yield (
            sum(w * x for w, x in zip(weights, xs, strict=True)),
            sum(w * y for w, y in zip(weights, ys, strict=True)),
        )


def _along(corners: Sequence[Point]) -> Iterator[Point]:
    """Points on straight lines, dense enough to meet every box."""
    for (x0, y0), (x1, y1) in itertools.pairwise(corners):
        steps = max(2, int((abs(x1 - x0) + abs(y1 - y0)) / 4))
        for number in range(steps + 1):
            yield x0 + (x1 - x0) * number / steps, y0 + (y1 - y0) * number / steps


def _is_free(points: Iterable[Point], boxes: Sequence[Rectangle]) -> bool:
    return not any(box.contains(x, y) for x, y in points for box in boxes)


def _moves(point: Point) -> str:
    return f"M{point[0]:.0f} {point[1]:.0f}"


_CHARACTER_WIDTH = 7.4
"""Width of a character at the font size of the boxes."""

_MAX_LABEL_CHARACTERS = 34
_LINE_HEIGHT = 15
_PADDING = 8
_COLUMN_GAP = 34
_ROW_GAP = 14
_TITLE_HEIGHT = 26
_MARGIN = _COLUMN_GAP / 2 + _PADDING
"""On both sides of all boxes, for arrows that come from another frame, or another row."""

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
class PlacedBox(Rectangle):
    """A box with its place and its text."""

    kind: BoxKind
    lines: tuple[TextLine, ...]
    title: str


@dataclass(frozen=True)
class Edge:
    """An arrow from one box to the next, as an SVG path."""

    path: str
    stored: bool


@dataclass(frozen=True)
class PhaseFrame(Rectangle):
    """The boxes of one phase, with its name."""

    title: str

    @property
    def heading(self) -> Rectangle:
        """The place of the title, from the top of the frame."""
        width = len(self.title) * _CHARACTER_WIDTH
        return Rectangle(TITLE_X, self.y + 4, width, _TITLE_HEIGHT - 10)


@dataclass(frozen=True)
class Drawing:
    """Everything that the page's template needs to write the SVG."""

    width: float
    height: float
    frames: tuple[PhaseFrame, ...]
    boxes: tuple[PlacedBox, ...]
    edges: tuple[Edge, ...]
    description: str


def lay_out(
    plan: Plan, annotations: Mapping[str, Sequence[str]], width: float = math.inf
) -> Drawing:
    """Place all boxes and arrows.

    Args:
        plan: the plan to draw.
        annotations: lines to add below the name of a box, by that name; those of a topic by
            ``topic NAME``, because a node may have the same name.
        width: in pixels, within which layers are placed beside each other, if one has room.
    """
    graph = drawn_graph(plan)
    y, widest = 2.0, 0.0
    frames: list[PhaseFrame] = []
    placed: dict[Box, PlacedBox] = {}
    for title in ("", *PHASES):
        inside = graph.subgraph(box for box in graph if box.phase == title)
        if not inside:
            continue
        top = y + (_TITLE_HEIGHT if title else 0)
        layers = _layers(inside, annotations, (_MARGIN, width - _MARGIN - 2), top)
        placed |= layers
        right = max(box.right for box in layers.values()) + _MARGIN
        bottom = max(box.bottom for box in layers.values()) + _PADDING
        if title:
            frames.append(PhaseFrame(0, y, right, bottom - y, title))
        widest = max(widest, right)
        y = bottom + _ROW_GAP
    obstacles = [*placed.values(), *(frame.heading for frame in frames)]
    edges = tuple(
        Edge(
            route(placed[tail], placed[head], obstacles, _COLUMN_GAP, _ROW_GAP),
            stored,
        )
        for tail, head, stored in arrows_of(graph)
    )
    return Drawing(
        width=widest + 2,
        height=y,
        frames=tuple(frames),
        boxes=tuple(placed.values()),
        edges=edges,
        description=_description(graph, placed),
    )


def _layers(
    graph: nx.DiGraph[Box],
    annotations: Mapping[str, Sequence[str]],
    sides: tuple[float, float],
    top: float,
) -> dict[Box, PlacedBox]:
    layer = _layer_indices(graph)
    placed: dict[Box, PlacedBox] = {}
    x = sides[0]
    for number in range(max(layer.values()) + 1):
        column = [box for box in graph if layer[box] == number]
        column.sort(key=lambda box: _mean_y([placed[b] for b in graph.pred[box] if b in placed]))
        shown = [_lines(box, annotations.get(_key(box), ())) for box in column]
        width = (
            max(len(text) for lines in shown for text in lines) * _CHARACTER_WIDTH + 2 * _PADDING
        )
        if x > sides[0] and x + width > sides[1]:
            x, top = sides[0], max(box.bottom for box in placed.values()) + 2 * _ROW_GAP
        y = top
        for box, lines in zip(column, shown, strict=True):
            placed[box] = _place_box(box, lines, x, y, width)
            y += placed[box].height + _ROW_GAP
        x += width + _COLUMN_GAP
    return placed


def _layer_indices(graph: nx.DiGraph[Box]) -> dict[Box, int]:
    """Return the layer of each box; the boxes of a cycle share a layer."""
    import networkx as nx

    components = nx.condensation(graph)
    # Each in the earliest layer that is after those of all its predecessors.
    return {
        box: layer
        for layer, generation in enumerate(nx.topological_generations(components))
        for component in generation
        for box in components.nodes[component]["members"]
    }


def _mean_y(boxes: Sequence[PlacedBox]) -> float:
    return sum(box.y for box in boxes) / len(boxes) if boxes else 0.0


def _key(box: Box) -> str:
    name = box.lines[0]
    return f"topic {name}" if box.kind == "topic" else name


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


def _description(graph: nx.DiGraph[Box], placed: Mapping[Box, PlacedBox]) -> str:
    texts = [f"{placed[tail].title} to {placed[head].title}" for tail, head in graph.edges]
    return (
        "Messages go from " + "; from ".join(texts) + "." if texts else "There are no connections."
    )
