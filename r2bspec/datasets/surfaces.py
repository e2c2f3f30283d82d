"""Where rays meet the surfaces of a room, and what these look like there: texture and paint.

The texture is value noise, made once and looked up everywhere. Only +, -, *, / and whole-number
hashing are used, which give the same bits on every machine.
"""

from __future__ import annotations

import random
from dataclasses import dataclass
from functools import lru_cache
from typing import Final

import numpy as np
from numpy.typing import NDArray

from r2bspec.datasets.scenes import FACES_PER_BOX, Box, Room

TEXELS: Final = 1024
TEXELS_PER_M: Final = 200.0

# Lattice points across the texture, coarse to fine, and their weights: features of 64 cm to 1 cm.
_OCTAVES: Final = (
    (8, 0.4),
    (16, 0.5),
    (32, 0.7),
    (64, 0.9),
    (128, 1.0),
    (256, 0.9),
    (512, 0.7),
)
_CONTRAST: Final = 0.95

# Seams between panels, every 64 cm, a centimetre wide and so much darker.
_SEAM_TEXELS: Final = 128
_SEAM_HALF_TEXELS: Final = 1.5
_SEAM_DEPTH: Final = 0.55

# Level k leaves out the k finest octaves: for surfaces that pass several of them in a pixel.
LEVELS: Final = 6
# A pixel must stay below half the finest feature of its level.
_FINEST_M: Final = 0.01
_LEVEL_LIMITS_M: Final = tuple(_FINEST_M / 2 * 2**level for level in range(LEVELS - 1))


def hash_noise(x: NDArray[np.uint32], y: NDArray[np.uint32], seed: int) -> NDArray[np.float32]:
    """Noise in [0, 1) for whole-number points, by multiplying and folding 32-bit integers."""
    mixed = (
        x * np.uint32(0x9E3779B1) + y * np.uint32(0x85EBCA77) + np.uint32(seed * 0xC2B2AE3D % 2**32)
    )
    for multiplier in (0x7FEB352D, 0x846CA68B):
        mixed ^= mixed >> np.uint32(15)
        mixed *= np.uint32(multiplier)
    mixed ^= mixed >> np.uint32(16)
    return (mixed >> np.uint32(8)).astype(np.float32) * np.float32(2**-24)


@lru_cache(maxsize=1)
def pyramid() -> NDArray[np.float32]:
    """The texture's levels, flattened: LEVELS * TEXELS * TEXELS values in [0, 1]; periodic."""
    total = np.zeros((TEXELS, TEXELS), np.float32)
    weight = 0.0
    levels: list[NDArray[np.float32]] = []
    for number, (points, octave_weight) in enumerate(_OCTAVES):
        total = total + (_octave(points, number) - np.float32(0.5)) * np.float32(octave_weight)
        weight += octave_weight
        if number >= len(_OCTAVES) - LEVELS:
            levels.insert(0, total)
    # One scale for all levels: leaving out an octave must not change the others' contrast.
    scale = np.float32(_CONTRAST * 2 / weight)
    flat = [
        (np.clip(noise * scale + np.float32(0.55), 0, 1) * _seams(level)).ravel()
        for level, noise in enumerate(levels)
    ]
    return np.concatenate(flat)


def _seams(level: int) -> NDArray[np.float32]:
    """Brightness around the seams, 1 away from them; coarser levels blur them out."""
    place = np.arange(TEXELS, dtype=np.float32) % np.float32(_SEAM_TEXELS)
    away = np.minimum(place, np.float32(_SEAM_TEXELS) - place)
    reach = np.float32(_SEAM_HALF_TEXELS * 2**level)
    dark = np.maximum(1 - away / reach, 0) * np.float32(_SEAM_DEPTH / 2**level)
    bright: NDArray[np.float32] = 1 - np.maximum(dark[:, None], dark[None, :])
    return bright


def _octave(points: int, seed: int) -> NDArray[np.float32]:
    """Noise on a periodic lattice, eased between its points; (TEXELS, TEXELS)."""
    lattice = np.arange(points, dtype=np.uint32)
    values = hash_noise(lattice[None, :], lattice[:, None], seed)
    place = np.arange(TEXELS, dtype=np.float32) * np.float32(points / TEXELS)
    before = place.astype(np.intp)
    share = place - before
    share = share * share * (3 - 2 * share)
    after = (before + 1) % points
    rows = values[before] * (1 - share[:, None]) + values[after] * share[:, None]
    octave: NDArray[np.float32] = rows[:, before] * (1 - share) + rows[:, after] * share
    return octave


def sample_texture(
    u_m: NDArray[np.float32], v_m: NDArray[np.float32], level: NDArray[np.int32]
) -> NDArray[np.float32]:
    """Look the texture up between its texels; arrays of one shape, result in [0, 1]."""
    texture = pyramid()
    u = u_m * np.float32(TEXELS_PER_M)
    v = v_m * np.float32(TEXELS_PER_M)
    left, top = np.floor(u), np.floor(v)
    u -= left
    v -= top
    mask = np.int32(TEXELS - 1)
    column = left.astype(np.int32) & mask
    row = (top.astype(np.int32) & mask) * np.int32(TEXELS)
    next_column = (column + np.int32(1)) & mask
    next_row = (row + np.int32(TEXELS)) & np.int32(TEXELS * TEXELS - 1)
    base = level * np.int32(TEXELS * TEXELS)
    row += base
    next_row += base
    upper = texture.take(row + column)
    upper += (texture.take(row + next_column) - upper) * u
    lower = texture.take(next_row + column)
    lower += (texture.take(next_row + next_column) - lower) * u
    result: NDArray[np.float32] = upper + (lower - upper) * v
    return result


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
        self._origin_m = tuple(np.asarray(part, np.float64) for part in origin_m)
        self.directions = directions
        with np.errstate(divide="ignore"):
            self._inverse = tuple(1 / component for component in directions)

    def intersect_shell(self, room: Room) -> Hits:
        """Intersect rays with walls, floor and ceiling; the origin must be inside."""
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


_LUMINANCE = (0.299, 0.587, 0.114)

# Light falls from above and a little from one side; faces in the order of surface numbers.
_LIGHT_BY_FACE = (0.86, 0.94, 0.78, 0.90, 0.97, 0.72)
_WALLS = (0.93, 0.90, 0.84)
_FLOOR = (0.66, 0.55, 0.45)
_CEILING = (0.95, 0.96, 0.97)
# Seen from inside: the ray that runs down meets the floor.
_SHELL = (_WALLS, _WALLS, _WALLS, _WALLS, _FLOOR, _CEILING)

# A lidar's spot is some centimetres wide.
_LIDAR_LEVEL = 2


def texture_level(
    surface: NDArray[np.int32],
    directions: tuple[NDArray[np.floating], ...],
    distance: NDArray[np.floating],
    focal_px: float,
) -> NDArray[np.int32]:
    """The texture level whose finest feature a pixel can still show, by distance and slant.

    Args:
        surface: what each ray meets.
        directions: of the rays, world x, y and z, of length 1 along the optical axis.
        distance: along the optical axis, metres.
        focal_px: of the camera.
    """
    axis = surface % FACES_PER_BOX // 2
    along_normal = np.where(
        axis == 0, directions[0], np.where(axis == 1, directions[1], directions[2])
    )
    pixel_m = distance / (np.float32(focal_px) * np.abs(along_normal))
    level = np.zeros(surface.shape, np.int32)
    for limit in _LEVEL_LIMITS_M:
        level += pixel_m > np.float32(limit)
    return level


def texture_values(
    room: Room,
    surface: NDArray[np.int32],
    points: tuple[NDArray[np.floating], ...],
    level: NDArray[np.int32],
) -> NDArray[np.float32]:
    """The texture in [0, 1] at points (world x, y, z in metres) of surfaces."""
    axis = surface % FACES_PER_BOX // 2
    shifts = _texture_offsets(room)
    u = np.where(axis == 0, points[1], points[0]) + shifts[0].take(surface)
    v = np.where(axis == 2, points[1], points[2]) + shifts[1].take(surface)
    return sample_texture(u.astype(np.float32, copy=False), v.astype(np.float32, copy=False), level)


def surface_brightness(
    paint: NDArray[np.float32], surface: NDArray[np.int32], shade: NDArray[np.float32]
) -> NDArray[np.float32]:
    """One channel's brightness, 0 to 255.

    Args:
        paint: dark and light end of every surface's range, (2, surfaces).
        surface: what is seen.
        shade: where in the range it is, 0 to 1.
    """
    dark = paint[0].take(surface)
    brightness: NDArray[np.float32] = dark + (paint[1].take(surface) - dark) * shade
    return brightness


def lidar_brightness(
    room: Room, surface: NDArray[np.int32], points: tuple[NDArray[np.floating], ...]
) -> NDArray[np.float32]:
    """Brightness 0 to 255 of points on surfaces, as a lidar's returns are strong."""
    shade = texture_values(room, surface, points, np.full(surface.shape, _LIDAR_LEVEL, np.int32))
    return surface_brightness(brightness_ranges(room, "mono8")[0], surface, shade)


@lru_cache(maxsize=16)
def brightness_ranges(room: Room, encoding: str) -> NDArray[np.float32]:
    """Dark and light end of each surface's range, 0 to 255, (channels, 2, surfaces)."""
    if encoding == "mono8":
        colour = brightness_ranges(room, "rgb8")
        red, green, blue = (np.float32(weight) for weight in _LUMINANCE)
        grey: NDArray[np.float32] = (colour[:1] * red + colour[1:2] * green) + colour[2:] * blue
        return grey
    rng = random.Random(room.seed + 1000)  # noqa: S311 -- scenery, not secrets
    table = np.empty((3, 2, room.surface_count), np.float32)
    for box in range(room.surface_count // FACES_PER_BOX):
        tint, accent = _colour(rng), _colour(rng)
        for face, light in enumerate(_LIGHT_BY_FACE):
            bright = _SHELL[face] if box == 0 else tint
            for channel in range(3):
                light_end = 240 * light * bright[channel]
                surface = box * FACES_PER_BOX + face
                table[channel, 0, surface] = light_end * 0.45 * accent[channel]
                table[channel, 1, surface] = light_end
    return table


def _colour(rng: random.Random) -> tuple[float, float, float]:
    """A colour of moderate saturation, each channel 0 to 1."""
    grey = rng.uniform(0.5, 0.8)
    red, green, blue = (grey * rng.uniform(0.7, 1.25) for _ in range(3))
    return (red, green, blue)


@lru_cache(maxsize=16)
def _texture_offsets(room: Room) -> NDArray[np.float32]:
    """Where in the texture each surface lies, metres, (2, surfaces): no two look alike."""
    rng = random.Random(room.seed)  # noqa: S311 -- scenery, not secrets
    return np.array(
        [[rng.uniform(0, 5) for _ in range(room.surface_count)] for _ in range(2)], np.float32
    )
