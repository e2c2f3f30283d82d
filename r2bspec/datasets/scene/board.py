"""Laying the tag's board into an image, exact to a small part of a pixel."""

from __future__ import annotations

from typing import TYPE_CHECKING

from r2bspec.datasets.scene.geometry import Pose
from r2bspec.datasets.scene.rig import Camera
from r2bspec.datasets.scene.tag import BOARD_CELLS, MARKER_CELLS, Tag, sample_board
from r2bspec.datasets.scene.view import MIN_DEPTH_M, image_bounds, undistorted

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

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
