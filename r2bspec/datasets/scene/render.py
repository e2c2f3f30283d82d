"""Rendering what a camera sees.

Everything is element by element in fixed order, so that the same numpy gives the same bytes; a
frame is worked through in bands of rows that stay in the processor's cache.
"""

from __future__ import annotations

from functools import lru_cache
from typing import TYPE_CHECKING

from r2bspec.datasets.scene.board import paint_tag
from r2bspec.datasets.scene.geometry import BODY_FROM_OPTICAL, Pose
from r2bspec.datasets.scene.rig import Camera
from r2bspec.datasets.scene.room import Hits, Rays, Room
from r2bspec.datasets.scene.surfaces import (
    brightness_ranges,
    surface_brightness,
    texture_level,
    texture_values,
)
from r2bspec.datasets.scene.tag import Tag
from r2bspec.datasets.scene.view import MIN_DEPTH_M, Bounds, image_bounds, undistorted

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

_BAND_ROWS = 32


def camera_pose(body: Pose, camera: Camera) -> Pose:
    """World from the camera's optical frame, given world from body."""
    return body.compose(Pose(camera.position_m, BODY_FROM_OPTICAL))


def render_image(room: Room, tag: Tag | None, camera: Camera, pose: Pose) -> NDArray[np.uint8]:
    """What a camera sees from a pose (world from optical frame).

    Returns:
        (height, width, 3) for rgb8, (height, width) for mono8.
    """
    import numpy as np

    table = brightness_ranges(room, camera.encoding)
    image = np.empty((camera.height, camera.width, len(table)), np.uint8)
    for rows in _bands(camera):
        rays = _camera_rays(camera, pose, rows)
        hits = _intersect(room, camera, pose, rays, rows)
        level = texture_level(hits.surface, rays.directions, hits.distance, camera.focal_px)
        shade = texture_values(room, hits.surface, rays.points(hits), level)
        for channel, paint in enumerate(table):
            image[rows, :, channel] = surface_brightness(paint, hits.surface, shade) + np.float32(
                0.5
            )
    if tag is not None:
        paint_tag(image, tag, camera, pose)
    return image if len(table) > 1 else image[:, :, 0]


def render_depth(room: Room, camera: Camera, pose: Pose) -> NDArray[np.float32]:
    """Distance along the optical axis in metres, (height, width)."""
    import numpy as np

    depth = np.empty((camera.height, camera.width), np.float32)
    for rows in _bands(camera):
        rays = _camera_rays(camera, pose, rows)
        depth[rows] = _intersect(room, camera, pose, rays, rows).distance
    return depth


def _bands(camera: Camera) -> list[slice]:
    return [
        slice(first, min(first + _BAND_ROWS, camera.height))
        for first in range(0, camera.height, _BAND_ROWS)
    ]


def _camera_rays(camera: Camera, pose: Pose, rows: slice) -> Rays:
    """Rays through pixel centres, with length 1 along the optical axis."""
    import numpy as np

    x = (np.arange(camera.width) - camera.center_px[0]) / camera.focal_px
    y = (np.arange(rows.start, rows.stop) - camera.center_px[1]) / camera.focal_px
    if camera.lens is not None:
        ideal_x, ideal_y = (part[rows] for part in _ideal_grid(camera))
        turned = (row[0] * ideal_x + row[1] * ideal_y + row[2] for row in pose.rotation)
        return Rays(pose.position_m, tuple(each.astype(np.float32) for each in turned))
    world_x, world_y, world_z = (
        (row[0] * x)[None, :].astype(np.float32) + (row[1] * y + row[2])[:, None].astype(np.float32)
        for row in pose.rotation
    )
    return Rays(pose.position_m, (world_x, world_y, world_z))


@lru_cache(maxsize=2)
def _ideal_grid(camera: Camera) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Where an ideal camera sees what each pixel shows, one focal length away; (height, width)."""
    import numpy as np

    across = np.empty((camera.height, camera.width))
    down = np.empty((camera.height, camera.width))
    for rows in _bands(camera):
        across[rows], down[rows] = undistorted(
            camera,
            np.arange(camera.width, dtype=np.float64),
            np.arange(rows.start, rows.stop, dtype=np.float64),
        )
    return across, down


def _intersect(room: Room, camera: Camera, pose: Pose, rays: Rays, rows: slice) -> Hits:
    """Intersect rays with the room and the boxes that are visible in the rows."""
    hits = rays.intersect_shell(room)
    for number, bounds in _box_bounds(room, camera, pose):
        top, bottom = max(bounds.top, rows.start), min(bounds.bottom, rows.stop)
        if top < bottom:
            part = (slice(top - rows.start, bottom - rows.start), bounds.columns)
            rays.intersect_box(room.boxes[number - 1], number, hits, part)
    return hits


@lru_cache(maxsize=16)
def _box_bounds(room: Room, camera: Camera, pose: Pose) -> tuple[tuple[int, Bounds], ...]:
    """Number and bounds of each box in view."""
    inverse = pose.inverse()
    found = []
    for number, box in enumerate(room.boxes, start=1):
        seen = [inverse.apply(corner) for corner in box.corners]
        if all(z < MIN_DEPTH_M for _, _, z in seen):
            continue
        bounds = image_bounds(camera, seen)
        if bounds is not None:
            found.append((number, bounds))
    return tuple(found)
