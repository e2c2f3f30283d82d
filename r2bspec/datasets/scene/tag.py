"""The AprilTag on its board, and how it is laid into an image, exact to a small part of a pixel."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

from r2bspec.datasets.scene.cameras import MIN_DEPTH_M, Camera, image_bounds, undistorted
from r2bspec.datasets.scene.motion import BODY_FROM_OPTICAL, Pose, Vector

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
    center_m: Vector
    id: int = _ID

    @property
    def pose(self) -> Pose:
        """World from tag. In a view along x, right is -y and down is -z."""
        return Pose(self.center_m, BODY_FROM_OPTICAL)


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


def tag_pose(tag: Tag, camera: Pose) -> Pose:
    """The tag in a camera's optical frame, given world from that frame."""
    return camera.inverse().compose(tag.pose)


def paint_tag(image: NDArray[np.uint8], tag: Tag, camera: Camera, pose: Pose) -> None:
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
    bounds = image_bounds(camera, corners)
    if bounds is None or any(z < MIN_DEPTH_M for _, _, z in corners):
        return
    rows = np.arange(bounds.top, bounds.bottom, dtype=np.float64)
    columns = np.arange(bounds.left, bounds.right, dtype=np.float64)
    brightness = np.zeros((len(rows), len(columns)))
    coverage = np.zeros((len(rows), len(columns)))
    shifts = [(number + 0.5) / _SAMPLES_PER_AXIS - 0.5 for number in range(_SAMPLES_PER_AXIS)]
    for down in shifts:
        for across in shifts:
            x, y = undistorted(camera, columns + across, rows + down)
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
    to_tag: Pose,
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
