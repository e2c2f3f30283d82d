"""The paths of arrows between placed boxes: they go around boxes, never through them.

A direct curve is taken where it is free. Otherwise an arrow leaves its box to the right, goes
along a lane between rows of boxes, and enters the next box from the left. The gaps between columns
have room for the vertical parts.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

_SAMPLES = 40
_CLEARANCE = 3.0


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
        """Whether a point is inside, or too close."""
        return (
            self.x - _CLEARANCE < x < self.right + _CLEARANCE
            and self.y - _CLEARANCE < y < self.bottom + _CLEARANCE
        )


Point = tuple[float, float]


def route(
    tail: Rectangle, head: Rectangle, boxes: Iterable[Rectangle], gap: float, row_gap: float
) -> str:
    """The path of an arrow, as SVG has it.

    Args:
        tail: where it begins.
        head: where it ends.
        boxes: all boxes of the drawing.
        gap: the room between two columns.
        row_gap: the room between two rows.
    """
    others = [each for each in boxes if each not in (tail, head)]
    start, end = (tail.right, tail.middle_y), (head.x, head.middle_y)
    if end[0] > start[0]:
        curve = list(_curve(start, end))
        if _is_free(curve, others):
            bend = (end[0] - start[0]) / 2
            return _moves(start) + _bezier(
                (start[0] + bend, start[1]), (end[0] - bend, end[1]), end
            )
    out_x, in_x = start[0] + gap / 2, end[0] - gap / 2
    candidates = [
        _corners(start, out_x, lane, in_x, end)
        for lane in _lanes((tail, head, *others), (start[1] + end[1]) / 2, row_gap)
    ]
    obstacles = [*others, tail, head]
    free = (each for each in candidates if _is_free(_along(each[1:-1]), obstacles))
    chosen = next(free, candidates[0])
    return _moves(start) + "".join(f"L{x:.0f} {y:.0f}" for x, y in chosen[1:])


def _corners(start: Point, out_x: float, lane: float, in_x: float, end: Point) -> list[Point]:
    return [start, (out_x, start[1]), (out_x, lane), (in_x, lane), (in_x, end[1]), end]


def _lanes(boxes: Sequence[Rectangle], wanted: float, row_gap: float) -> list[float]:
    """The heights between rows, those nearest to the direct way first."""
    heights = {each.y - row_gap / 2 for each in boxes}
    heights |= {each.bottom + row_gap / 2 for each in boxes}
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


def _bezier(first: Point, second: Point, end: Point) -> str:
    return "C" + " ".join(f"{x:.0f} {y:.0f}" for x, y in (first, second, end))
