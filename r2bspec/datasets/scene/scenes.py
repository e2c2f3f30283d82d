"""The rooms of the sequences and the way the rig moves in each."""

from __future__ import annotations

import random
from dataclasses import dataclass
from functools import lru_cache

from r2bspec.datasets.scene.geometry import Vector
from r2bspec.datasets.scene.motion import Motion, Track
from r2bspec.datasets.scene.room import Box, Room
from r2bspec.datasets.scene.tag import Tag

# Nothing stands nearer to the rig's path than this.
_CLEARANCE_M = 1.0


@dataclass(frozen=True, slots=True)
class Place:
    """What a sequence shows and how it is seen."""

    room: Room
    motion: Motion
    tag: Tag | None = None


@dataclass(frozen=True, slots=True)
class _Sketch:
    """A place in a few numbers.

    Attributes:
        size_m: the room, from the origin in x and z and centred in y.
        rest_m: where the rig sways about.
        looks_rad: yaw and pitch about which it turns.
        sway_m: how far it moves in x, y, z.
        clutter: boxes to strew, with at most so large edges in metres.
    """

    size_m: Vector
    rest_m: Vector
    looks_rad: tuple[float, float]
    sway_m: Vector
    clutter: int
    largest_m: Vector


_SKETCHES: dict[str, _Sketch] = {
    "r2b_lounge": _Sketch(
        size_m=(9, 7, 2.8),
        rest_m=(2.0, 0.2, 0.9),
        looks_rad=(0.1, 0.06),
        sway_m=(0.25, 0.3, 0.04),
        clutter=14,
        largest_m=(1.6, 1.4, 0.8),
    ),
    "r2b_storage": _Sketch(
        size_m=(7, 6, 2.8),
        rest_m=(2.35, 0.5, 1.0),
        looks_rad=(-0.3, 0.0),
        sway_m=(0.12, 0.15, 0.05),
        clutter=12,
        largest_m=(0.9, 0.9, 1.9),
    ),
    "r2b_hallway": _Sketch(
        size_m=(18, 2.6, 2.6),
        rest_m=(3.0, 0.0, 0.9),
        looks_rad=(0.0, 0.0),
        sway_m=(0.9, 0.12, 0.03),
        clutter=10,
        largest_m=(1.2, 0.5, 1.6),
    ),
    "r2b_datacenter": _Sketch(
        size_m=(11, 6.4, 3.0),
        rest_m=(2.0, 0.0, 1.1),
        looks_rad=(0.05, 0.0),
        sway_m=(0.5, 0.2, 0.03),
        clutter=16,
        largest_m=(1.1, 1.1, 2.3),
    ),
    "r2b_cafe": _Sketch(
        size_m=(10, 8, 3.2),
        rest_m=(2.2, -0.4, 1.0),
        looks_rad=(-0.12, 0.05),
        sway_m=(0.3, 0.25, 0.04),
        clutter=16,
        largest_m=(1.3, 1.3, 1.1),
    ),
    "r2b_hideaway": _Sketch(
        size_m=(5, 4.4, 2.4),
        rest_m=(1.3, 0.1, 0.9),
        looks_rad=(0.08, 0.04),
        sway_m=(0.1, 0.12, 0.04),
        clutter=12,
        largest_m=(0.8, 0.8, 1.5),
    ),
    "r2b_mezzanine": _Sketch(
        size_m=(14, 10, 4.5),
        rest_m=(2.5, 0.5, 1.2),
        looks_rad=(0.0, 0.03),
        sway_m=(0.4, 0.4, 0.05),
        clutter=18,
        largest_m=(1.6, 1.6, 2.0),
    ),
    "r2b_hope": _Sketch(
        size_m=(5, 5, 2.8),
        rest_m=(1.6, 0.0, 1.35),
        looks_rad=(0.0, 0.42),
        sway_m=(0.05, 0.12, 0.05),
        clutter=6,
        largest_m=(0.8, 0.8, 1.5),
    ),
}

_CRATE = Box((3.4, -0.40, 0.0), (3.95, 0.30, 1.3))
_TABLE = (
    Box((2.4, -0.8, 0.0), (3.4, 0.8, 0.72)),
    Box((2.55, -0.45, 0.72), (2.63, -0.28, 0.95)),
    Box((2.70, -0.15, 0.72), (2.86, 0.02, 0.80)),
    Box((2.60, 0.20, 0.72), (2.68, 0.30, 0.90)),
    Box((2.95, 0.35, 0.72), (3.10, 0.62, 0.84)),
    Box((3.05, -0.50, 0.72), (3.15, -0.30, 1.02)),
)
_FURNITURE = {"r2b_storage": (_CRATE,), "r2b_hope": _TABLE}
_TAGS = {"r2b_storage": Tag(size_m=0.162, center_m=(3.4, -0.05, 1.02))}


@lru_cache(maxsize=8)
def place(name: str) -> Place:
    """The place of a sequence.

    Raises:
        KeyError: no sequence has that name.
    """
    sketch = _SKETCHES[name]
    # Seeded by its position in the table: hashes of strings differ from process to process.
    seed = 1 + list(_SKETCHES).index(name)
    choose = random.Random(seed)  # noqa: S311 -- scenery, not secrets
    furniture = _FURNITURE.get(name, ())
    boxes = (*furniture, *_strew(sketch, choose, furniture))
    length, width, height = sketch.size_m
    shell = Box((0.0, -width / 2, 0.0), (length, width / 2, height))
    return Place(Room(shell, boxes, seed), _sway(sketch, choose), _TAGS.get(name))


def _sway(sketch: _Sketch, choose: random.Random) -> Motion:
    """Two incommensurate waves a coordinate: no two frames are alike."""

    def track(rest: float, reach: float, hertz: float) -> Track:
        return Track(
            rest,
            (
                (reach * 0.75, hertz, choose.uniform(0, 6)),
                (reach * 0.25, hertz * 2.3, choose.uniform(0, 6)),
            ),
        )

    yaw, pitch = sketch.looks_rad
    return Motion(
        x=track(sketch.rest_m[0], sketch.sway_m[0], 0.13),
        y=track(sketch.rest_m[1], sketch.sway_m[1], 0.17),
        z=track(sketch.rest_m[2], sketch.sway_m[2], 0.31),
        yaw=track(yaw, 0.09, 0.19),
        pitch=track(pitch, 0.04, 0.27),
        roll=track(0.0, 0.035, 0.23),
    )


def _strew(sketch: _Sketch, choose: random.Random, furniture: tuple[Box, ...]) -> list[Box]:
    """Boxes on the floor that leave the rig room and do not hide the furniture."""
    length, width, _ = sketch.size_m
    boxes: list[Box] = []
    while len(boxes) < sketch.clutter:
        size = [limit * choose.uniform(0.35, 1.0) for limit in sketch.largest_m]
        low_x = choose.uniform(0, length - size[0])
        low_y = choose.uniform(-width / 2, width / 2 - size[1])
        box = Box((low_x, low_y, 0.0), (low_x + size[0], low_y + size[1], size[2]))
        if not _blocks(box, sketch, furniture):
            boxes.append(box)
    return boxes


def _blocks(box: Box, sketch: _Sketch, furniture: tuple[Box, ...]) -> bool:
    """Whether a box stands in the rig's way, or between it and the furniture."""
    margins = [reach + _CLEARANCE_M for reach in sketch.sway_m]
    keep_low = [sketch.rest_m[axis] - margins[axis] for axis in (0, 1)]
    keep_high = [sketch.rest_m[axis] + margins[axis] for axis in (0, 1)]
    if furniture:
        keep_high[0] = max(keep_high[0], *(piece.high_m[0] for piece in furniture))
        keep_low[1] = min(keep_low[1], *(piece.low_m[1] for piece in furniture))
        keep_high[1] = max(keep_high[1], *(piece.high_m[1] for piece in furniture))
    # A narrow room cannot keep its sides clear; what stands there must be thin, and is.
    half_width = sketch.size_m[1] / 2
    if half_width < 2 * _CLEARANCE_M:
        keep_low[1] = max(keep_low[1], -half_width + sketch.largest_m[1])
        keep_high[1] = min(keep_high[1], half_width - sketch.largest_m[1])
    return all(
        box.low_m[axis] < keep_high[axis] and box.high_m[axis] > keep_low[axis] for axis in (0, 1)
    )
