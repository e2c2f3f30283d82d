"""The rooms of the sequences, the way the rig moves in each, and the AprilTag on its board.

The tag is laid into an image exact to a small part of a pixel.
"""

from __future__ import annotations

import random
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import TYPE_CHECKING, Final, NamedTuple

from r2bspec.datasets import cameras

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray


FAMILY: Final = "36h11"

# Number 3 of the family, as its authors publish and print it: the 6x6 cells inside the black
# border row by row from the top left, the first the highest bit, 1 is white. OpenCV's dictionary
# has it upside down up to 5.0.
_ID: Final = 3
_CODE: Final = 0xE479E9C98
_PAYLOAD_CELLS: Final = 6

MARKER_CELLS: Final = _PAYLOAD_CELLS + 2
# A white quiet zone of one cell surrounds the black border.
BOARD_CELLS: Final = MARKER_CELLS + 2

WHITE: Final = 232.0
BLACK: Final = 22.0


@dataclass(frozen=True, slots=True)
class Tag:
    """A tag on a face that looks along the world's -x.

    Its frame has x right and y down in the tag's own image, as its authors print it, and z into
    the tag, so that a tag seen frontally is not rotated against the camera's optical frame.

    Attributes:
        size_m: edge of the outer square of the black border.
        center_m: in the world.
    """

    size_m: float
    center_m: cameras.Vector
    id: int = _ID

    @property
    def pose(self) -> cameras.Pose:
        """World from tag. In a view along x, right is -y and down is -z."""
        return cameras.Pose(self.center_m, cameras.BODY_FROM_OPTICAL)


def board_cells() -> NDArray[np.float32]:
    """Brightness of the board's cells, shape (12, 12): the board and a rim that repeats it."""
    import numpy as np

    cells = np.full((BOARD_CELLS + 2, BOARD_CELLS + 2), WHITE, np.float32)
    cells[2:-2, 2:-2] = BLACK
    for place in range(_PAYLOAD_CELLS**2):
        if _CODE >> (_PAYLOAD_CELLS**2 - 1 - place) & 1:
            row, column = divmod(place, _PAYLOAD_CELLS)
            cells[3 + row, 3 + column] = WHITE
    return cells


def sample_board(
    across: NDArray[np.float64],
    down: NDArray[np.float64],
    across_width: NDArray[np.float64],
    down_width: NDArray[np.float64],
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Brightness and coverage of the board, averaged over a box around each sample.

    A box that is smaller than a cell straddles at most one cell border in each direction, so
    its exact mean is a linear ramp across the border.

    Args:
        across: position from the board's left edge, in cells.
        down: position from its top edge, in cells.
        across_width: extent of the box in cells.
        down_width: likewise downwards.

    Returns:
        Brightness 0 to 255, and the share of the box that the board covers.
    """
    import numpy as np

    cells = board_cells()
    left, right_share, inside_across = _ramp(across, across_width)
    top, bottom_share, inside_down = _ramp(down, down_width)
    # The rim shifts the cells by one: cell k of the board is cells[k + 1].
    upper = cells[top, left] * (1 - right_share) + cells[top, left + 1] * right_share
    lower = cells[top + 1, left] * (1 - right_share) + cells[top + 1, left + 1] * right_share
    brightness = upper * (1 - bottom_share) + lower * bottom_share
    return np.asarray(brightness), inside_across * inside_down


def _ramp(
    position: NDArray[np.float64], width: NDArray[np.float64]
) -> tuple[NDArray[np.intp], NDArray[np.float64], NDArray[np.float64]]:
    """The cell before the nearest border, the share beyond that border, the share on the board."""
    import numpy as np

    border = np.clip(np.floor(position + 0.5), 0, BOARD_CELLS)
    share = np.clip((position - border) / width + 0.5, 0.0, 1.0)
    inside = np.clip(position / width + 0.5, 0.0, 1.0) * np.clip(
        (BOARD_CELLS - position) / width + 0.5, 0.0, 1.0
    )
    return border.astype(np.intp), share, inside


# Samples across and down a pixel; each is itself averaged over its share of the pixel.
_SAMPLES_PER_AXIS = 3


def tag_pose(tag: Tag, camera: cameras.Pose) -> cameras.Pose:
    """The tag in a camera's optical frame, given world from that frame."""
    return camera.inverse().compose(tag.pose)


def paint_tag(
    image: NDArray[np.uint8], tag: Tag, camera: cameras.Camera, pose: cameras.Pose
) -> None:
    """Lay the board over the face that carries it, smooth at every edge.

    Nothing may stand between the camera and the tag; places are laid out so.

    Args:
        image: (height, width, channels), changed in place.
        tag: the tag.
        camera: that takes the image.
        pose: world from its optical frame.
    """
    import numpy as np

    to_tag = tag_pose(tag, pose)
    half = tag.size_m * BOARD_CELLS / MARKER_CELLS / 2
    corners = [to_tag.apply((x, y, 0.0)) for x in (-half, half) for y in (-half, half)]
    bounds = cameras.image_bounds(camera, corners)
    if bounds is None or any(z < cameras.MIN_DEPTH_M for _, _, z in corners):
        return
    rows = np.arange(bounds.top, bounds.bottom, dtype=np.float64)
    columns = np.arange(bounds.left, bounds.right, dtype=np.float64)
    brightness = np.zeros((len(rows), len(columns)))
    coverage = np.zeros((len(rows), len(columns)))
    shifts = [(number + 0.5) / _SAMPLES_PER_AXIS - 0.5 for number in range(_SAMPLES_PER_AXIS)]
    for down in shifts:
        for across in shifts:
            x, y = cameras.undistorted(camera, columns + across, rows + down)
            sample_px = 1 / (camera.focal_px * _SAMPLES_PER_AXIS)
            value, share = sample_board(
                *_board_coordinates(to_tag, tag.size_m / MARKER_CELLS, x, y, sample_px)
            )
            brightness += value * share
            coverage += share
    region = image[bounds.top : bounds.bottom, bounds.columns]
    for channel in range(image.shape[2]):
        behind = region[:, :, channel] * (1 - coverage / _SAMPLES_PER_AXIS**2)
        region[:, :, channel] = behind + brightness / _SAMPLES_PER_AXIS**2 + 0.5


def _board_coordinates(
    to_tag: cameras.Pose,
    cell_m: float,
    x: NDArray[np.float64],
    y: NDArray[np.float64],
    sample: float,
) -> tuple[NDArray[np.float64], ...]:
    """Where rays (x, y, 1) meet the board, and how much of it a sample sees, in cells.

    With R and p rotation and position of the camera in the tag's frame, the point z (x, y, 1)
    of the camera lies on the tag's plane where z (R3 . ray) + p3 = 0; its coordinates there are
    z (R1 . ray) + p1 and z (R2 . ray) + p2, and their derivatives the sample's extent.

    Returns:
        Position across and down from the board's corner, extent across and down.
    """
    import numpy as np

    back = to_tag.inverse()
    third, p3 = back.rotation[2], back.position_m[2]
    depth = -p3 / (third[0] * x + third[1] * y + third[2])
    places, extents = [], []
    for row, offset in zip(back.rotation[:2], back.position_m[:2], strict=True):
        position = depth * (row[0] * x + row[1] * y + row[2])
        by_x = depth * (row[0] + position * third[0] / p3)
        by_y = depth * (row[1] + position * third[1] / p3)
        places.append((position + offset) / cell_m + BOARD_CELLS / 2)
        extents.append((np.abs(by_x) + np.abs(by_y)) * (sample / cell_m))
    return (*places, *extents)


FACES_PER_BOX = 6


@dataclass(frozen=True, slots=True)
class Box:
    """An axis-aligned box, metres."""

    low_m: cameras.Vector
    high_m: cameras.Vector

    @property
    def corners(self) -> tuple[cameras.Vector, ...]:
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
    motion: cameras.Motion
    tag: Tag | None = None


class _SceneParameters(NamedTuple):
    """A place in a few numbers.

    Attributes:
        size_m: the room, from the origin in x and z and centred in y.
        rest_m: where the rig sways about.
        yaw_pitch_rad: yaw and pitch about which it turns.
        amplitude_m: how far it moves in x, y, z.
        box_count: boxes to strew, with at most so large edges in metres.
    """

    size_m: cameras.Vector
    rest_m: cameras.Vector
    yaw_pitch_rad: tuple[float, float]
    amplitude_m: cameras.Vector
    box_count: int
    max_edges_m: cameras.Vector


# In each row: size, rest, yaw and pitch, amplitude, number of boxes, longest edges.
_SCENES: dict[str, _SceneParameters] = {
    "r2b_lounge": _SceneParameters(
        (9, 7, 2.8), (2.0, 0.2, 0.9), (0.1, 0.06), (0.25, 0.3, 0.04), 14, (1.6, 1.4, 0.8)
    ),
    "r2b_storage": _SceneParameters(
        (7, 6, 2.8), (2.35, 0.5, 1.0), (-0.3, 0.0), (0.12, 0.15, 0.05), 12, (0.9, 0.9, 1.9)
    ),
    "r2b_hallway": _SceneParameters(
        (18, 2.6, 2.6), (3.0, 0.0, 0.9), (0.0, 0.0), (0.9, 0.12, 0.03), 10, (1.2, 0.5, 1.6)
    ),
    "r2b_datacenter": _SceneParameters(
        (11, 6.4, 3.0), (2.0, 0.0, 1.1), (0.05, 0.0), (0.5, 0.2, 0.03), 16, (1.1, 1.1, 2.3)
    ),
    "r2b_cafe": _SceneParameters(
        (10, 8, 3.2), (2.2, -0.4, 1.0), (-0.12, 0.05), (0.3, 0.25, 0.04), 16, (1.3, 1.3, 1.1)
    ),
    "r2b_hideaway": _SceneParameters(
        (5, 4.4, 2.4), (1.3, 0.1, 0.9), (0.08, 0.04), (0.1, 0.12, 0.04), 12, (0.8, 0.8, 1.5)
    ),
    "r2b_mezzanine": _SceneParameters(
        (14, 10, 4.5), (2.5, 0.5, 1.2), (0.0, 0.03), (0.4, 0.4, 0.05), 18, (1.6, 1.6, 2.0)
    ),
    "r2b_hope": _SceneParameters(
        (5, 5, 2.8), (1.6, 0.0, 1.35), (0.0, 0.42), (0.05, 0.12, 0.05), 6, (0.8, 0.8, 1.5)
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


def _motion(parameters: _SceneParameters, rng: random.Random) -> cameras.Motion:
    """Two incommensurate waves a coordinate: no two frames are alike."""

    def track(rest: float, reach: float, hertz: float) -> cameras.Track:
        return cameras.Track(
            rest,
            (
                (reach * 0.75, hertz, rng.uniform(0, 6)),
                (reach * 0.25, hertz * 2.3, rng.uniform(0, 6)),
            ),
        )

    yaw, pitch = parameters.yaw_pitch_rad
    return cameras.Motion(
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
