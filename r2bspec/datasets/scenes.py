"""The scenes of the sequences: textured planes across the view, and an AprilTag on one of them."""

from __future__ import annotations

import random
from functools import lru_cache
from typing import Final

import msgspec

from r2bspec.datasets.geometry import BODY_FROM_OPTICAL, Motion, Pose, Vector, Wave

TAG_ID: Final = 3
# Number 3 of the family 36h11, as its authors publish and print it: the 6x6 cells inside the black
# border row by row from the top left, the first the highest bit, 1 is white. OpenCV's dictionary
# has it upside down up to 5.0.
TAG_CODE: Final = 0xE479E9C98
PAYLOAD_CELLS: Final = 6
MARKER_CELLS: Final = PAYLOAD_CELLS + 2
# A white quiet zone of one cell surrounds the black border.
BOARD_CELLS: Final = MARKER_CELLS + 2

_BOARDS: Final = 10
_NEAREST_M, _WALL_M = 1.9, 4.5


class Board(msgspec.Struct, frozen=True):
    """A rectangle that looks along the world's -x.

    Attributes:
        center_m: in the world.
        width_m: along the world's y.
        height_m: along its z.
        color: its brightest red, green and blue, 0 to 255.
        shift_texels: where its texture begins.
    """

    center_m: Vector
    width_m: float
    height_m: float
    color: Vector
    shift_texels: tuple[float, float]


class Tag(msgspec.Struct, frozen=True):
    """A tag that looks along the world's -x.

    Its frame has x right and y down in the tag's own image, as its authors print it, and z into
    the tag, so that a tag seen frontally is not rotated against the camera's optical frame.

    Attributes:
        size_m: edge of the outer square of the black border.
        center_m: in the world.
    """

    size_m: float
    center_m: Vector

    @property
    def pose(self) -> Pose:
        """World from tag. In a view along x, right is -y and down is -z."""
        return Pose(self.center_m, BODY_FROM_OPTICAL)


class Scene(msgspec.Struct, frozen=True):
    """The content of a sequence, and the motion of the rig.

    Attributes:
        boards: the first is the wall behind all others; a tag is nearer than all.
    """

    boards: tuple[Board, ...]
    motion: Motion
    tag: Tag | None


_TAGS: Final = {"r2b_storage": Tag(size_m=0.162, center_m=(1.2, -0.05, 0.02))}


@lru_cache(maxsize=8)
def find_scene(name: str) -> Scene:
    """Return the scene of a sequence by its name."""
    rng = random.Random(name)  # noqa: S311 -- scenery, not secrets
    wall = _board(rng, _WALL_M, 100.0)
    boards = (_board(rng, rng.uniform(_NEAREST_M, _WALL_M - 0.3), 0.0) for _ in range(_BOARDS))
    return Scene((wall, *boards), _motion(rng), _TAGS.get(name))


def _board(rng: random.Random, distance_m: float, size_m: float) -> Board:
    """Return a board somewhere in view at a distance; its size is chosen if 0."""
    width_m, height_m = (size_m or distance_m * rng.uniform(0.15, 0.5) for _ in range(2))
    reach = 0.0 if size_m else distance_m
    return Board(
        (distance_m, rng.uniform(-0.8, 0.8) * reach, rng.uniform(-0.45, 0.45) * reach),
        width_m,
        height_m,
        (rng.uniform(130, 240), rng.uniform(130, 240), rng.uniform(130, 240)),
        (rng.uniform(0, 500), rng.uniform(0, 500)),
    )


def _motion(rng: random.Random) -> Motion:
    """Return slow waves of incommensurate frequencies: no two frames are alike."""

    def wave(amplitude: float, hertz: float) -> Wave:
        return Wave(amplitude, hertz, rng.uniform(0, 6))

    return Motion(
        x=wave(0.15, 0.13),
        y=wave(0.15, 0.17),
        z=wave(0.05, 0.31),
        yaw=wave(0.08, 0.19),
        pitch=wave(0.04, 0.27),
        roll=wave(0.035, 0.23),
    )
