"""A turn of a spinning lidar, fired column by column while the rig moves."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from r2bspec.datasets.scene.motion import Motion
from r2bspec.datasets.scene.rig import Lidar
from r2bspec.datasets.scene.room import Rays, Room
from r2bspec.datasets.scene.sizes import CLOUD_FIELDS, CLOUD_POINT_BYTES
from r2bspec.datasets.scene.surfaces import lidar_brightness
from r2bspec.datasets.scene.waves import cosine, sine

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

_NUMPY_TYPES = {7: "<f4", 4: "<u2", 8: "<f8"}


def cloud_dtype() -> np.dtype[np.void]:
    """The packed layout of a point."""
    import numpy as np

    return np.dtype(
        {
            "names": [name for name, _, _ in CLOUD_FIELDS],
            "formats": [_NUMPY_TYPES[kind] for _, _, kind in CLOUD_FIELDS],
            "offsets": [offset for _, offset, _ in CLOUD_FIELDS],
            "itemsize": CLOUD_POINT_BYTES,
        }
    )


def scan(
    room: Room, motion: Motion, lidar: Lidar, start_ns: int, offset_ns: int, turn_ns: int
) -> NDArray[np.void]:
    """The points of one turn, in firing order, rings inside columns.

    Each column is seen from where the rig is at that column's time, which its `timestamp` says,
    in seconds since the epoch; x, y and z are in the lidar's frame at that same time.

    Args:
        room: what is scanned.
        motion: of the rig.
        lidar: the sensor.
        start_ns: start of the sequence, ns since the epoch.
        offset_ns: start of the turn after that.
        turn_ns: how long a turn takes.

    Returns:
        (columns * beams,) of `cloud_dtype`.
    """
    import numpy as np

    beams = [math.radians(elevation) for elevation in lidar.elevations_deg]
    flat = np.array([cosine(beam) for beam in beams])[None, :]
    up = np.array([sine(beam) for beam in beams])[None, :]
    times_ns = [offset_ns + column * turn_ns // lidar.columns for column in range(lidar.columns)]
    # Seen from above, the head turns clockwise.
    angles = [-2 * math.pi * column / lidar.columns for column in range(lidar.columns)]
    ahead = np.array([cosine(angle) for angle in angles])[:, None] * flat
    left = np.array([sine(angle) for angle in angles])[:, None] * flat

    poses = [motion.pose(time_ns / 1e9) for time_ns in times_ns]
    origins = np.array([pose.apply(lidar.position_m) for pose in poses])
    rotations = np.array([pose.rotation for pose in poses])
    directions = tuple(
        rotations[:, axis, :1] * ahead
        + rotations[:, axis, 1:2] * left
        + rotations[:, axis, 2:] * up
        for axis in range(3)
    )
    rays = Rays(tuple(origins[:, axis : axis + 1] for axis in range(3)), directions)
    hits = rays.intersect_shell(room)
    everything = (slice(None), slice(None))
    for number, box in enumerate(room.boxes, start=1):
        rays.intersect_box(box, number, hits, everything)

    cloud = np.empty((lidar.columns, len(beams)), cloud_dtype())
    cloud["x"] = ahead * hits.distance
    cloud["y"] = left * hits.distance
    cloud["z"] = up * hits.distance
    cloud["intensity"] = lidar_brightness(room, hits.surface, rays.points(hits))
    cloud["ring"] = np.arange(len(beams))[None, :]
    cloud["timestamp"] = np.array([(start_ns + time_ns) / 1e9 for time_ns in times_ns])[:, None]
    return cloud.ravel()
