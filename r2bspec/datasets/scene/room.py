"""A room and its axis-aligned boxes, and their intersections with rays."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

from r2bspec.datasets.scene.geometry import Vector

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

FACES_PER_BOX = 6


@dataclass(frozen=True, slots=True)
class Box:
    """An axis-aligned box, metres."""

    low_m: Vector
    high_m: Vector

    @property
    def corners(self) -> tuple[Vector, ...]:
        """Its eight corners."""
        pairs = tuple(zip(self.low_m, self.high_m, strict=True))
        return tuple((x, y, z) for x in pairs[0] for y in pairs[1] for z in pairs[2])


@dataclass(frozen=True)
class Room:
    """The world: the inside of one box and the outsides of others.

    Surfaces are numbered: box * 6 + axis * 2 + side; the shell is box 0. `side` is 1 where the
    ray that hits runs along the axis, 0 where it runs against it.
    """

    shell: Box
    boxes: tuple[Box, ...]
    seed: int

    @cached_property
    def surface_count(self) -> int:
        """How many numbers surfaces have."""
        return FACES_PER_BOX * (1 + len(self.boxes))


@dataclass(slots=True)
class Hits:
    """Where rays end; arrays of one shape.

    Attributes:
        distance: along the ray, in units of its direction's length.
        surface: number of the surface that is met.
    """

    distance: NDArray[np.floating]
    surface: NDArray[np.int32]


class Rays:
    """A grid of rays, (rows, columns).

    Args:
        origin_m: x, y and z in the world; numbers, or arrays that broadcast over the grid.
        directions: x, y and z components in the world; any length.
    """

    def __init__(
        self,
        origin_m: tuple[float | NDArray[np.float64], ...],
        directions: tuple[NDArray[np.floating], ...],
    ) -> None:
        import numpy as np

        self._origin_m = tuple(np.asarray(part, np.float64) for part in origin_m)
        self.directions = directions
        with np.errstate(divide="ignore"):
            self._inverse = tuple(1 / component for component in directions)

    def intersect_shell(self, room: Room) -> Hits:
        """Intersect rays with walls, floor and ceiling; the origin must be inside."""
        import numpy as np

        leaves = []
        for axis in range(3):
            low, high = self._side_distances(room.shell, axis)
            leaves.append(np.maximum(low * self._inverse[axis], high * self._inverse[axis]))
        distance = leaves[0]
        axis_met = np.zeros(distance.shape, np.int32)
        along = self.directions[0] > 0
        for axis in (1, 2):
            nearer = leaves[axis] < distance
            distance = np.minimum(distance, leaves[axis])
            np.copyto(axis_met, np.int32(2 * axis), where=nearer)
            np.copyto(along, self.directions[axis] > 0, where=nearer)
        return Hits(distance, axis_met + along)

    def intersect_box(self, box: Box, number: int, hits: Hits, part: tuple[slice, slice]) -> None:
        """Meet one box from outside where it is nearer than what was met before.

        Args:
            box: the box.
            number: its number; the shell is 0.
            hits: updated in place.
            part: rows and columns to look at; all, where the origins differ.
        """
        import numpy as np

        distance = hits.distance[part]
        surface = hits.surface[part]
        enters = np.full(distance.shape, -np.inf, distance.dtype)
        leaves = np.full(distance.shape, np.inf, distance.dtype)
        face = np.zeros(distance.shape, np.int32)
        with np.errstate(invalid="ignore"):
            for axis in range(3):
                inverse = self._inverse[axis][part]
                low, high = (side * inverse for side in self._side_distances(box, axis))
                enter = np.minimum(low, high)
                later = enter > enters
                np.copyto(enters, enter, where=later)
                np.copyto(face, np.int32(2 * axis) + (inverse > 0), where=later)
                leaves = np.minimum(leaves, np.maximum(low, high))
            nearer = (enters < leaves) & (enters > 0) & (enters < distance)
        np.copyto(distance, enters, where=nearer)
        np.copyto(surface, face + np.int32(FACES_PER_BOX * number), where=nearer)

    def points(self, hits: Hits) -> tuple[NDArray[np.floating], ...]:
        """World x, y and z of the hits, metres."""
        return tuple(
            origin.astype(direction.dtype) + hits.distance * direction
            for origin, direction in zip(self._origin_m, self.directions, strict=True)
        )

    def _side_distances(
        self, box: Box, axis: int
    ) -> tuple[NDArray[np.floating], NDArray[np.floating]]:
        """How far the box's two sides are from the origins along an axis, as the rays' numbers.

        Subtracted before rounding, so that near things keep their digits.
        """
        kind = self.directions[axis].dtype
        origin = self._origin_m[axis]
        low = (box.low_m[axis] - origin).astype(kind)
        high = (box.high_m[axis] - origin).astype(kind)
        return low, high
