"""The rooms of the sequences, and the way the rig moves in each."""

from __future__ import annotations

import random
from dataclasses import dataclass
from functools import cached_property, lru_cache

from r2bspec.datasets.scene.motion import Motion, Track, Vector
from r2bspec.datasets.scene.tag import Tag

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


# The minimum distance of all objects from the path of the rig.
_CLEARANCE_M = 1.0


@dataclass(frozen=True, slots=True)
class Scene:
    """What a sequence shows and how it is seen."""

    room: Room
    motion: Motion
    tag: Tag | None = None


@dataclass(frozen=True, slots=True)
class _SceneParameters:
    """A place in a few numbers.

    Attributes:
        size_m: the room, from the origin in x and z and centred in y.
        rest_m: where the rig sways about.
        yaw_pitch_rad: yaw and pitch about which it turns.
        amplitude_m: how far it moves in x, y, z.
        box_count: boxes to strew, with at most so large edges in metres.
    """

    size_m: Vector
    rest_m: Vector
    yaw_pitch_rad: tuple[float, float]
    amplitude_m: Vector
    box_count: int
    max_edges_m: Vector


_SCENES: dict[str, _SceneParameters] = {
    "r2b_lounge": _SceneParameters(
        size_m=(9, 7, 2.8),
        rest_m=(2.0, 0.2, 0.9),
        yaw_pitch_rad=(0.1, 0.06),
        amplitude_m=(0.25, 0.3, 0.04),
        box_count=14,
        max_edges_m=(1.6, 1.4, 0.8),
    ),
    "r2b_storage": _SceneParameters(
        size_m=(7, 6, 2.8),
        rest_m=(2.35, 0.5, 1.0),
        yaw_pitch_rad=(-0.3, 0.0),
        amplitude_m=(0.12, 0.15, 0.05),
        box_count=12,
        max_edges_m=(0.9, 0.9, 1.9),
    ),
    "r2b_hallway": _SceneParameters(
        size_m=(18, 2.6, 2.6),
        rest_m=(3.0, 0.0, 0.9),
        yaw_pitch_rad=(0.0, 0.0),
        amplitude_m=(0.9, 0.12, 0.03),
        box_count=10,
        max_edges_m=(1.2, 0.5, 1.6),
    ),
    "r2b_datacenter": _SceneParameters(
        size_m=(11, 6.4, 3.0),
        rest_m=(2.0, 0.0, 1.1),
        yaw_pitch_rad=(0.05, 0.0),
        amplitude_m=(0.5, 0.2, 0.03),
        box_count=16,
        max_edges_m=(1.1, 1.1, 2.3),
    ),
    "r2b_cafe": _SceneParameters(
        size_m=(10, 8, 3.2),
        rest_m=(2.2, -0.4, 1.0),
        yaw_pitch_rad=(-0.12, 0.05),
        amplitude_m=(0.3, 0.25, 0.04),
        box_count=16,
        max_edges_m=(1.3, 1.3, 1.1),
    ),
    "r2b_hideaway": _SceneParameters(
        size_m=(5, 4.4, 2.4),
        rest_m=(1.3, 0.1, 0.9),
        yaw_pitch_rad=(0.08, 0.04),
        amplitude_m=(0.1, 0.12, 0.04),
        box_count=12,
        max_edges_m=(0.8, 0.8, 1.5),
    ),
    "r2b_mezzanine": _SceneParameters(
        size_m=(14, 10, 4.5),
        rest_m=(2.5, 0.5, 1.2),
        yaw_pitch_rad=(0.0, 0.03),
        amplitude_m=(0.4, 0.4, 0.05),
        box_count=18,
        max_edges_m=(1.6, 1.6, 2.0),
    ),
    "r2b_hope": _SceneParameters(
        size_m=(5, 5, 2.8),
        rest_m=(1.6, 0.0, 1.35),
        yaw_pitch_rad=(0.0, 0.42),
        amplitude_m=(0.05, 0.12, 0.05),
        box_count=6,
        max_edges_m=(0.8, 0.8, 1.5),
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
def find_scene(name: str) -> Scene:
    """The place of a sequence.

    Raises:
        KeyError: no sequence has that name.
    """
    parameters = _SCENES[name]
    # Seeded by its position in the table: hashes of strings differ from process to process.
    seed = 1 + list(_SCENES).index(name)
    rng = random.Random(seed)  # noqa: S311 -- scenery, not secrets
    furniture = _FURNITURE.get(name, ())
    boxes = (*furniture, *_scatter_boxes(parameters, rng, furniture))
    length, width, height = parameters.size_m
    shell = Box((0.0, -width / 2, 0.0), (length, width / 2, height))
    return Scene(Room(shell, boxes, seed), _motion(parameters, rng), _TAGS.get(name))


def _motion(parameters: _SceneParameters, rng: random.Random) -> Motion:
    """Two incommensurate waves a coordinate: no two frames are alike."""

    def track(rest: float, reach: float, hertz: float) -> Track:
        return Track(
            rest,
            (
                (reach * 0.75, hertz, rng.uniform(0, 6)),
                (reach * 0.25, hertz * 2.3, rng.uniform(0, 6)),
            ),
        )

    yaw, pitch = parameters.yaw_pitch_rad
    return Motion(
        x=track(parameters.rest_m[0], parameters.amplitude_m[0], 0.13),
        y=track(parameters.rest_m[1], parameters.amplitude_m[1], 0.17),
        z=track(parameters.rest_m[2], parameters.amplitude_m[2], 0.31),
        yaw=track(yaw, 0.09, 0.19),
        pitch=track(pitch, 0.04, 0.27),
        roll=track(0.0, 0.035, 0.23),
    )


def _scatter_boxes(
    parameters: _SceneParameters, rng: random.Random, furniture: tuple[Box, ...]
) -> list[Box]:
    """Boxes on the floor that keep clear of the rig's path and do not hide the furniture."""
    length, width, _ = parameters.size_m
    boxes: list[Box] = []
    while len(boxes) < parameters.box_count:
        size = [limit * rng.uniform(0.35, 1.0) for limit in parameters.max_edges_m]
        low_x = rng.uniform(0, length - size[0])
        low_y = rng.uniform(-width / 2, width / 2 - size[1])
        box = Box((low_x, low_y, 0.0), (low_x + size[0], low_y + size[1], size[2]))
        if not _is_in_the_way(box, parameters, furniture):
            boxes.append(box)
    return boxes


def _is_in_the_way(box: Box, parameters: _SceneParameters, furniture: tuple[Box, ...]) -> bool:
    """Whether a box blocks the path of the rig, or its view of the furniture."""
    margins = [reach + _CLEARANCE_M for reach in parameters.amplitude_m]
    keep_low = [parameters.rest_m[axis] - margins[axis] for axis in (0, 1)]
    keep_high = [parameters.rest_m[axis] + margins[axis] for axis in (0, 1)]
    if furniture:
        keep_high[0] = max(keep_high[0], *(piece.high_m[0] for piece in furniture))
        keep_low[1] = min(keep_low[1], *(piece.low_m[1] for piece in furniture))
        keep_high[1] = max(keep_high[1], *(piece.high_m[1] for piece in furniture))
    # A narrow room cannot keep its sides clear; the objects there are thin.
    half_width = parameters.size_m[1] / 2
    if half_width < 2 * _CLEARANCE_M:
        keep_low[1] = max(keep_low[1], -half_width + parameters.max_edges_m[1])
        keep_high[1] = min(keep_high[1], half_width - parameters.max_edges_m[1])
    return all(
        box.low_m[axis] < keep_high[axis] and box.high_m[axis] > keep_low[axis] for axis in (0, 1)
    )
