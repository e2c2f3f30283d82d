"""The view of a camera on a scene, and its depth.

Everything is element by element in fixed order, with +, -, *, / and whole-number hashing alone, so
that every machine gives the same bytes. A frame is processed in bands of rows that stay in the
processor's cache.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from r2bspec.datasets import scenes
from r2bspec.datasets.geometry import BODY_FROM_OPTICAL, Pose
from r2bspec.datasets.rig import Camera

_BAND_ROWS = 32
_LUMINANCE = (0.299, 0.587, 0.114)

_TEXELS = 512
# A texel is so wide that a camera of the rig shows it on two to four pixels: no finer detail would
# be seen the same from two sides.
_TEXELS_PER_M_AT_1_M = 260.0
# Lattice points across the texture, coarse to fine, and their weights.
_OCTAVES = ((8, 0.4), (32, 0.6), (128, 1.0), (512, 0.8))
_DARK = 0.3

# Samples across and down a pixel of the tag, so that its edges are smooth.
_SAMPLES_PER_AXIS = 3
_WHITE, _BLACK = 232.0, 22.0


class _Rays(NamedTuple):
    """Directions of rays in the world, of length 1 along the optical axis; (rows, columns)."""

    x: NDArray[np.float32]
    y: NDArray[np.float32]
    z: NDArray[np.float32]


def camera_pose(body: Pose, camera: Camera) -> Pose:
    """Return world from the camera's optical frame, given world from body."""
    return body.compose(Pose(camera.position_m, BODY_FROM_OPTICAL))


def render_image(scene: scenes.Scene, camera: Camera, body: Pose) -> NDArray[np.uint8]:
    """Return the image of a camera, given world from body.

    Returns:
        (height, width, 3) for rgb8, (height, width) for mono8.
    """
    pose = camera_pose(body, camera)
    bright = _colors(scene, camera.encoding)
    image = np.empty((camera.height, camera.width, len(bright)), np.uint8)
    scales = np.array([_TEXELS_PER_M_AT_1_M / each.center_m[0] for each in scene.boards])
    shifts = np.array([each.shift_texels for each in scene.boards]).astype(np.float32)
    for rows in _bands(camera):
        rays = _rays(camera, pose, rows)
        depth, board = _meet(scene, pose, rays)
        scale = scales.astype(np.float32).take(board)
        across = (np.float32(pose.position_m[1]) + depth * rays.y) * scale
        up = (np.float32(pose.position_m[2]) + depth * rays.z) * scale
        shade = _sample(across + shifts[:, 0].take(board), up + shifts[:, 1].take(board))
        for channel, levels in enumerate(bright):
            image[rows, :, channel] = levels.take(board) * shade + np.float32(0.5)
    if scene.tag is not None:
        _paint_tag(image, scene.tag, camera, pose)
    return image if len(bright) > 1 else image[:, :, 0]


def render_depth(scene: scenes.Scene, camera: Camera, body: Pose) -> NDArray[np.float32]:
    """Return the distance along the optical axis in metres, (height, width)."""
    pose = camera_pose(body, camera)
    depth = np.empty((camera.height, camera.width), np.float32)
    for rows in _bands(camera):
        depth[rows] = _meet(scene, pose, _rays(camera, pose, rows))[0]
    return depth


def _bands(camera: Camera) -> Iterator[slice]:
    for first in range(0, camera.height, _BAND_ROWS):
        yield slice(first, min(first + _BAND_ROWS, camera.height))


def _rays(camera: Camera, pose: Pose, rows: slice) -> _Rays:
    """Return the rays through the centres of the pixels of some rows."""
    x = (np.arange(camera.width) - camera.center_px[0]) / camera.focal_px
    y = (np.arange(rows.start, rows.stop) - camera.center_px[1]) / camera.focal_px
    return _Rays(
        *(
            (row[0] * x)[None, :].astype(np.float32)
            + (row[1] * y + row[2])[:, None].astype(np.float32)
            for row in pose.rotation
        )
    )


def _meet(
    scene: scenes.Scene, pose: Pose, rays: _Rays
) -> tuple[NDArray[np.float32], NDArray[np.intp]]:
    """Return how far along each ray the nearest board is, and its number."""
    x, y, z = pose.position_m
    depth = np.full(rays.x.shape, np.inf, np.float32)
    number = np.zeros(rays.x.shape, np.intp)
    for index, board in enumerate(scene.boards):
        distance = np.float32(board.center_m[0] - x) / rays.x
        across = np.float32(y - board.center_m[1]) + distance * rays.y
        up = np.float32(z - board.center_m[2]) + distance * rays.z
        met = np.abs(across) < np.float32(board.width_m / 2)
        met &= np.abs(up) < np.float32(board.height_m / 2)
        met &= distance < depth
        np.copyto(depth, distance, where=met)
        np.copyto(number, index, where=met)
    return depth, number


def _colors(scene: scenes.Scene, encoding: str) -> tuple[NDArray[np.float32], ...]:
    """Return the brightest value of each board, for each channel."""
    red, green, blue = np.array([board.color for board in scene.boards]).astype(np.float32).T
    if encoding == "rgb8":
        return red, green, blue
    weights = [np.float32(weight) for weight in _LUMINANCE]
    return (red * weights[0] + green * weights[1] + blue * weights[2],)


def hash_noise(x: NDArray[np.uint32], y: NDArray[np.uint32], seed: int) -> NDArray[np.float32]:
    """Return noise in [0, 1) for whole-number points, by multiplying and folding integers."""
    mixed = (
        x * np.uint32(0x9E3779B1) + y * np.uint32(0x85EBCA77) + np.uint32(seed * 0xC2B2AE3D % 2**32)
    )
    for multiplier in (0x7FEB352D, 0x846CA68B):
        mixed ^= mixed >> np.uint32(15)
        mixed *= np.uint32(multiplier)
    mixed ^= mixed >> np.uint32(16)
    return (mixed >> np.uint32(8)).astype(np.float32) * np.float32(2**-24)


@lru_cache(maxsize=1)
def _texture() -> NDArray[np.float32]:
    """Return a periodic texture, (_TEXELS * _TEXELS) values between _DARK and 1."""
    total = np.zeros((_TEXELS, _TEXELS), np.float32)
    for seed, (points, weight) in enumerate(_OCTAVES):
        lattice = np.arange(points, dtype=np.uint32)
        values = hash_noise(lattice[None, :], lattice[:, None], seed)
        place = np.arange(_TEXELS, dtype=np.float32) * np.float32(points / _TEXELS)
        before = place.astype(np.intp)
        after, share = (before + 1) % points, place - before
        rows = values[before] * (1 - share[:, None]) + values[after] * share[:, None]
        total += (rows[:, before] * (1 - share) + rows[:, after] * share) * np.float32(weight)
    low, high = total.min(), total.max()
    texture: NDArray[np.float32] = (total - low) / (high - low) * np.float32(1 - _DARK)
    texture += np.float32(_DARK)
    return texture.ravel()


def _sample(across: NDArray[np.float32], up: NDArray[np.float32]) -> NDArray[np.float32]:
    """Look the texture up between its texels; arrays of one shape."""
    texture = _texture()
    left, low = np.floor(across), np.floor(up)
    right_share, high_share = across - left, up - low
    mask = np.int32(_TEXELS - 1)
    column = left.astype(np.int32) & mask
    row = (low.astype(np.int32) & mask) * np.int32(_TEXELS)
    next_column = (column + np.int32(1)) & mask
    next_row = (row + np.int32(_TEXELS)) & np.int32(_TEXELS * _TEXELS - 1)
    below = texture.take(row + column)
    below += (texture.take(row + next_column) - below) * right_share
    above = texture.take(next_row + column)
    above += (texture.take(next_row + next_column) - above) * right_share
    return np.asarray(below + (above - below) * high_share)


def square_corners_px(
    tag: scenes.Tag, camera: Camera, pose: Pose, half_m: float
) -> list[tuple[float, float]]:
    """Return the pixels of the corners of a square around the centre of a tag.

    They go clockwise from the top left in the tag's own image.

    Args:
        tag: the tag.
        camera: the camera that sees it.
        pose: world from the camera's optical frame.
        half_m: half of an edge of the square.
    """
    to_tag = pose.inverse().compose(tag.pose)
    places = ((-half_m, -half_m), (half_m, -half_m), (half_m, half_m), (-half_m, half_m))
    points = [to_tag.apply((x, y, 0.0)) for x, y in places]
    return [
        (
            camera.focal_px * x / z + camera.center_px[0],
            camera.focal_px * y / z + camera.center_px[1],
        )
        for x, y, z in points
    ]


def board_cells() -> NDArray[np.float32]:
    """Return the brightness of the cells of the tag with its white border, (10, 10)."""
    cells = np.full((scenes.BOARD_CELLS, scenes.BOARD_CELLS), _WHITE, np.float32)
    cells[1:-1, 1:-1] = _BLACK
    for place in range(scenes.PAYLOAD_CELLS**2):
        if scenes.TAG_CODE >> (scenes.PAYLOAD_CELLS**2 - 1 - place) & 1:
            row, column = divmod(place, scenes.PAYLOAD_CELLS)
            cells[2 + row, 2 + column] = _WHITE
    return cells


def _paint_tag(image: NDArray[np.uint8], tag: scenes.Tag, camera: Camera, pose: Pose) -> None:
    """Lay the tag over an image (height, width, channels); nothing stands before it."""
    cell_m = tag.size_m / scenes.MARKER_CELLS
    corners = square_corners_px(tag, camera, pose, cell_m * scenes.BOARD_CELLS / 2)
    left, top = (max(0, int(min(corner[axis] for corner in corners)) - 1) for axis in (0, 1))
    right, bottom = (int(max(corner[axis] for corner in corners)) + 2 for axis in (0, 1))
    region = image[top:bottom, left:right]
    cells = np.pad(board_cells(), 1)
    rows, columns = (np.arange(length) for length in region.shape[:2])
    brightness = np.zeros(region.shape[:2])
    coverage = np.zeros(region.shape[:2])
    steps = [(number + 0.5) / _SAMPLES_PER_AXIS - 0.5 for number in range(_SAMPLES_PER_AXIS)]
    for down in steps:
        for across in steps:
            x = ((columns + left + across - camera.center_px[0]) / camera.focal_px)[None, :]
            y = ((rows + top + down - camera.center_px[1]) / camera.focal_px)[:, None]
            along = [row[0] * x + row[1] * y + row[2] for row in pose.rotation]
            depth = (tag.center_m[0] - pose.position_m[0]) / along[0]
            # Right is -y and down is -z; the padding is cell 0.
            places = [
                np.clip(
                    np.floor(
                        (tag.center_m[axis] - pose.position_m[axis] - depth * along[axis]) / cell_m
                        + scenes.BOARD_CELLS / 2
                    ).astype(np.intp)
                    + 1,
                    0,
                    scenes.BOARD_CELLS + 1,
                )
                for axis in (2, 1)
            ]
            found = cells[places[0], places[1]]
            brightness += found
            coverage += found > 0
    samples = _SAMPLES_PER_AXIS**2
    for channel in range(image.shape[2]):
        behind = region[:, :, channel] * (1 - coverage / samples)
        region[:, :, channel] = behind + brightness / samples + 0.5
