"""What the sensors of the rig see, as the CDR bytes of their messages: images, depth, clouds, IMU.

Everything is element by element in fixed order, so that the same numpy gives the same bytes; a
frame is worked through in bands of rows that stay in the processor's cache.
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from r2bspec.bags.message_types import typestore
from r2bspec.datasets import cameras, rig, surfaces
from r2bspec.datasets.scenes import Room, Scene, Tag, paint_tag

_BAND_ROWS = 32


def render_image(
    room: Room, tag: Tag | None, camera: cameras.Camera, pose: cameras.Pose
) -> NDArray[np.uint8]:
    """What a camera sees from a pose (world from optical frame).

    Returns:
        (height, width, 3) for rgb8, (height, width) for mono8.
    """
    table = surfaces.brightness_ranges(room, camera.encoding)
    image = np.empty((camera.height, camera.width, len(table)), np.uint8)
    for rows in _bands(camera):
        rays = _camera_rays(camera, pose, rows)
        hits = _intersect(room, camera, pose, rays, rows)
        level = surfaces.texture_level(
            hits.surface, rays.directions, hits.distance, camera.focal_px
        )
        shade = surfaces.texture_values(room, hits.surface, rays.points(hits), level)
        for channel, paint in enumerate(table):
            image[rows, :, channel] = surfaces.surface_brightness(
                paint, hits.surface, shade
            ) + np.float32(0.5)
    if tag is not None:
        paint_tag(image, tag, camera, pose)
    return image if len(table) > 1 else image[:, :, 0]


def render_depth(room: Room, camera: cameras.Camera, pose: cameras.Pose) -> NDArray[np.float32]:
    """Distance along the optical axis in metres, (height, width)."""
    depth = np.empty((camera.height, camera.width), np.float32)
    for rows in _bands(camera):
        rays = _camera_rays(camera, pose, rows)
        depth[rows] = _intersect(room, camera, pose, rays, rows).distance
    return depth


def _bands(camera: cameras.Camera) -> list[slice]:
    return [
        slice(first, min(first + _BAND_ROWS, camera.height))
        for first in range(0, camera.height, _BAND_ROWS)
    ]


def _camera_rays(camera: cameras.Camera, pose: cameras.Pose, rows: slice) -> surfaces.Rays:
    """Rays through pixel centres, with length 1 along the optical axis."""
    x = (np.arange(camera.width) - camera.center_px[0]) / camera.focal_px
    y = (np.arange(rows.start, rows.stop) - camera.center_px[1]) / camera.focal_px
    if camera.lens is not None:
        ideal_x, ideal_y = (part[rows] for part in _ideal_grid(camera))
        turned = (row[0] * ideal_x + row[1] * ideal_y + row[2] for row in pose.rotation)
        return surfaces.Rays(pose.position_m, tuple(part.astype(np.float32) for part in turned))
    world_x, world_y, world_z = (
        (row[0] * x)[None, :].astype(np.float32) + (row[1] * y + row[2])[:, None].astype(np.float32)
        for row in pose.rotation
    )
    return surfaces.Rays(pose.position_m, (world_x, world_y, world_z))


@lru_cache(maxsize=2)
def _ideal_grid(camera: cameras.Camera) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Where an ideal camera sees what each pixel shows, one focal length away; (height, width)."""
    across = np.empty((camera.height, camera.width))
    down = np.empty((camera.height, camera.width))
    for rows in _bands(camera):
        across[rows], down[rows] = cameras.undistorted(
            camera,
            np.arange(camera.width, dtype=np.float64),
            np.arange(rows.start, rows.stop, dtype=np.float64),
        )
    return across, down


def _intersect(
    room: Room, camera: cameras.Camera, pose: cameras.Pose, rays: surfaces.Rays, rows: slice
) -> surfaces.Hits:
    """Intersect rays with the room and the boxes that are visible in the rows."""
    hits = rays.intersect_shell(room)
    for number, bounds in _box_bounds(room, camera, pose):
        top, bottom = max(bounds.top, rows.start), min(bounds.bottom, rows.stop)
        if top < bottom:
            part = (slice(top - rows.start, bottom - rows.start), bounds.columns)
            rays.intersect_box(room.boxes[number - 1], number, hits, part)
    return hits


@lru_cache(maxsize=16)
def _box_bounds(
    room: Room, camera: cameras.Camera, pose: cameras.Pose
) -> tuple[tuple[int, cameras.Bounds], ...]:
    """Number and bounds of each box in view."""
    inverse = pose.inverse()
    visible = []
    for number, box in enumerate(room.boxes, start=1):
        seen = [inverse.apply(corner) for corner in box.corners]
        if all(z < cameras.MIN_DEPTH_M for _, _, z in seen):
            continue
        bounds = cameras.image_bounds(camera, seen)
        if bounds is not None:
            visible.append((number, bounds))
    return tuple(visible)


_NUMPY_TYPES = {7: "<f4", 4: "<u2", 8: "<f8"}


def cloud_dtype() -> np.dtype[np.void]:
    """The packed layout of a point."""
    return np.dtype(
        {
            "names": [name for name, _, _ in rig.CLOUD_FIELDS],
            "formats": [_NUMPY_TYPES[kind] for _, _, kind in rig.CLOUD_FIELDS],
            "offsets": [offset for _, offset, _ in rig.CLOUD_FIELDS],
            "itemsize": rig.CLOUD_POINT_BYTES,
        }
    )


def scan(
    room: Room,
    motion: cameras.Motion,
    lidar: rig.Lidar,
    start_ns: int,
    offset_ns: int,
    turn_ns: int,
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
    beams = [math.radians(elevation) for elevation in lidar.elevations_deg]
    flat = np.array([cameras.cosine(beam) for beam in beams])[None, :]
    up = np.array([cameras.sine(beam) for beam in beams])[None, :]
    times_ns = [offset_ns + column * turn_ns // lidar.columns for column in range(lidar.columns)]
    # Seen from above, the head turns clockwise.
    angles = [-2 * math.pi * column / lidar.columns for column in range(lidar.columns)]
    ahead = np.array([cameras.cosine(angle) for angle in angles])[:, None] * flat
    left = np.array([cameras.sine(angle) for angle in angles])[:, None] * flat

    poses = [motion.pose(time_ns / 1e9) for time_ns in times_ns]
    origins = np.array([pose.apply(lidar.position_m) for pose in poses])
    rotations = np.array([pose.rotation for pose in poses])
    directions = tuple(
        rotations[:, axis, :1] * ahead
        + rotations[:, axis, 1:2] * left
        + rotations[:, axis, 2:] * up
        for axis in range(3)
    )
    rays = surfaces.Rays(tuple(origins[:, axis : axis + 1] for axis in range(3)), directions)
    hits = rays.intersect_shell(room)
    everything = (slice(None), slice(None))
    for number, box in enumerate(room.boxes, start=1):
        rays.intersect_box(box, number, hits, everything)

    cloud = np.empty((lidar.columns, len(beams)), cloud_dtype())
    cloud["x"] = ahead * hits.distance
    cloud["y"] = left * hits.distance
    cloud["z"] = up * hits.distance
    cloud["intensity"] = surfaces.lidar_brightness(room, hits.surface, rays.points(hits))
    cloud["ring"] = np.arange(len(beams))[None, :]
    cloud["timestamp"] = np.array([(start_ns + time_ns) / 1e9 for time_ns in times_ns])[:, None]
    return cloud.ravel()


_DEPTH_ENCODING = "16UC1"
_MM_PER_M = 1000

# Variances of a good MEMS device, (rad/s)^2 and (m/s^2)^2; the values themselves are exact.
_GYRO_VARIANCE = 1e-6
_ACCELEROMETER_VARIANCE = 1e-4


def render_message(scene: Scene, source: rig.TopicSource, start_ns: int, offset_ns: int) -> bytes:
    """The message of a topic at a time.

    Args:
        scene: what is there to be seen.
        source: the topic.
        start_ns: start of the sequence, ns since the epoch.
        offset_ns: of the message, after that start; both together are its stamp.
    """
    makers = {
        rig.IMAGE: _image,
        rig.CAMERA_INFO: _camera_info,
        rig.IMU: _imu,
        rig.POINT_CLOUD: _cloud,
    }
    message = makers[source.type](scene, source, start_ns, offset_ns)
    return bytes(typestore().serialize_cdr(message, source.type))


def _type(name: str) -> Any:
    return typestore().types[name]


def _header(source: rig.TopicSource, time_ns: int) -> Any:
    seconds, nanoseconds = divmod(time_ns, 10**9)
    stamp = _type("builtin_interfaces/msg/Time")(sec=seconds, nanosec=nanoseconds)
    return _type("std_msgs/msg/Header")(stamp=stamp, frame_id=source.frame_id)


def _camera_of(source: rig.TopicSource) -> cameras.Camera:
    if source.camera is None:
        raise ValueError(f"{source.name} has no camera")
    return source.camera


def _image(scene: Scene, source: rig.TopicSource, start_ns: int, offset_ns: int) -> Any:
    camera = _camera_of(source)
    pose = cameras.camera_pose(scene.motion.pose(offset_ns / 1e9), camera)
    if camera.encoding == _DEPTH_ENCODING:
        metres = render_depth(scene.room, camera, pose)
        pixels = (metres * np.float32(_MM_PER_M) + np.float32(0.5)).astype("<u2").view(np.uint8)
    else:
        pixels = render_image(scene.room, scene.tag, camera, pose)
    return _type(rig.IMAGE)(
        header=_header(source, start_ns + offset_ns),
        height=camera.height,
        width=camera.width,
        encoding=camera.encoding,
        is_bigendian=0,
        step=camera.width * camera.bytes_per_pixel,
        data=pixels.reshape(-1),
    )


def _camera_info(_: Scene, source: rig.TopicSource, start_ns: int, offset_ns: int) -> Any:
    camera = _camera_of(source)
    focal, (cx, cy) = camera.focal_px, camera.center_px
    shift = -focal * camera.baseline_m
    return _type(rig.CAMERA_INFO)(
        header=_header(source, start_ns + offset_ns),
        height=camera.height,
        width=camera.width,
        distortion_model=rig.DISTORTION_MODEL,
        d=np.array(camera.lens.coefficients if camera.lens else (0.0,) * rig.DISTORTION_TERMS),
        k=np.array([focal, 0, cx, 0, focal, cy, 0, 0, 1], np.float64),
        r=np.array([1, 0, 0, 0, 1, 0, 0, 0, 1], np.float64),
        p=np.array([focal, 0, cx, shift, 0, focal, cy, 0, 0, 0, 1, 0], np.float64),
        binning_x=0,
        binning_y=0,
        roi=_type("sensor_msgs/msg/RegionOfInterest")(
            x_offset=0, y_offset=0, height=0, width=0, do_rectify=False
        ),
    )


def _imu(scene: Scene, source: rig.TopicSource, start_ns: int, offset_ns: int) -> Any:
    """Rate and specific force in optical axes, as the camera's driver gives them."""
    seconds = offset_ns / 1e9
    optical_from_body = cameras.transpose(cameras.BODY_FROM_OPTICAL)
    vector = _type("geometry_msgs/msg/Vector3")
    rate = cameras.apply(optical_from_body, scene.motion.angular_velocity_rad_s(seconds))
    force = cameras.apply(optical_from_body, scene.motion.specific_force_m_s2(seconds))
    return _type(rig.IMU)(
        header=_header(source, start_ns + offset_ns),
        orientation=_type("geometry_msgs/msg/Quaternion")(x=0.0, y=0.0, z=0.0, w=1.0),
        # -1 says that the device estimates no orientation.
        orientation_covariance=np.array([-1.0] + [0.0] * 8),
        angular_velocity=vector(*rate),
        angular_velocity_covariance=np.eye(3).ravel() * _GYRO_VARIANCE,
        linear_acceleration=vector(*force),
        linear_acceleration_covariance=np.eye(3).ravel() * _ACCELEROMETER_VARIANCE,
    )


def _cloud(scene: Scene, source: rig.TopicSource, start_ns: int, offset_ns: int) -> Any:
    if source.lidar is None:
        raise ValueError(f"{source.name} has no lidar")
    turn_ns = 10**9 // source.rate_hz
    points = scan(scene.room, scene.motion, source.lidar, start_ns, offset_ns, turn_ns)
    field = _type("sensor_msgs/msg/PointField")
    return _type(rig.POINT_CLOUD)(
        header=_header(source, start_ns + offset_ns),
        height=1,
        width=len(points),
        fields=[
            field(name=name, offset=offset, datatype=kind, count=1)
            for name, offset, kind in rig.CLOUD_FIELDS
        ],
        is_bigendian=False,
        point_step=rig.CLOUD_POINT_BYTES,
        row_step=rig.CLOUD_POINT_BYTES * len(points),
        data=np.frombuffer(points.tobytes(), np.uint8),
        is_dense=True,
    )
