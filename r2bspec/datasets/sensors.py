"""The messages of the sensors of the rig, as CDR: images, depth, scans, IMU."""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from r2bspec.bags.message_types import typestore
from r2bspec.datasets import geometry, rendering, rig
from r2bspec.datasets.scenes import Scene

_NUMPY_TYPES = {7: "<f4", 4: "<u2", 8: "<f8"}

# How far the walls are from the lidar: before and behind, beside, below and above, metres.
_WALLS_M = (4.5, 5.0, 1.2)


def cloud_dtype() -> np.dtype[np.void]:
    """Return the packed layout of a point."""
    return np.dtype(
        {
            "names": [name for name, _, _ in rig.CLOUD_FIELDS],
            "formats": [_NUMPY_TYPES[kind] for _, _, kind in rig.CLOUD_FIELDS],
            "offsets": [offset for _, offset, _ in rig.CLOUD_FIELDS],
            "itemsize": rig.CLOUD_POINT_BYTES,
        }
    )


@lru_cache(maxsize=1)
def _scan(lidar: rig.Lidar) -> NDArray[np.void]:
    """Return the points of one turn in an empty room, rings inside columns; times are zero."""
    beams = [math.radians(elevation) for elevation in lidar.elevations_deg]
    # Seen from above, the head turns clockwise.
    angles = [-2 * math.pi * column / lidar.columns for column in range(lidar.columns)]
    flat = np.array([geometry.cosine(beam) for beam in beams])[None, :]
    directions = (
        np.array([geometry.cosine(angle) for angle in angles])[:, None] * flat,
        np.array([geometry.sine(angle) for angle in angles])[:, None] * flat,
        np.broadcast_to([geometry.sine(beam) for beam in beams], (lidar.columns, len(beams))),
    )
    with np.errstate(divide="ignore"):
        reach = [wall / np.abs(along) for wall, along in zip(_WALLS_M, directions, strict=True)]
    distance = np.minimum(np.minimum(reach[0], reach[1]), reach[2])
    cloud = np.zeros((lidar.columns, len(beams)), cloud_dtype())
    for name, along in zip("xyz", directions, strict=True):
        cloud[name] = along * distance
    cloud["intensity"] = 255 / (1 + distance)
    cloud["ring"] = np.arange(len(beams))[None, :]
    return cloud


_DEPTH_ENCODING = "16UC1"
_MM_PER_M = 1000

# Variances of a good MEMS device, (rad/s)^2 and (m/s^2)^2; the values themselves are exact.
_GYRO_VARIANCE = 1e-6
_ACCELEROMETER_VARIANCE = 1e-4


def render_message(scene: Scene, source: rig.TopicSource, start_ns: int, offset_ns: int) -> bytes:
    """Return the message of a topic at a time.

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


def _camera_of(source: rig.TopicSource) -> rig.Camera:
    if source.camera is None:
        raise ValueError(f"{source.name} has no camera")
    return source.camera


def _image(scene: Scene, source: rig.TopicSource, start_ns: int, offset_ns: int) -> Any:
    camera = _camera_of(source)
    body = scene.motion.pose(offset_ns / 1e9)
    if camera.encoding == _DEPTH_ENCODING:
        metres = rendering.render_depth(scene, camera, body)
        pixels = (metres * np.float32(_MM_PER_M) + np.float32(0.5)).astype("<u2").view(np.uint8)
    else:
        pixels = rendering.render_image(scene, camera, body)
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
        d=np.zeros(rig.DISTORTION_TERMS),
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
    optical_from_body = geometry.transpose(geometry.BODY_FROM_OPTICAL)
    vector = _type("geometry_msgs/msg/Vector3")
    rate = geometry.apply(optical_from_body, scene.motion.angular_velocity_rad_s(seconds))
    force = geometry.apply(optical_from_body, scene.motion.specific_force_m_s2(seconds))
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


def _cloud(_: Scene, source: rig.TopicSource, start_ns: int, offset_ns: int) -> Any:
    if source.lidar is None:
        raise ValueError(f"{source.name} has no lidar")
    lidar = source.lidar
    turn_s = np.arange(lidar.columns) / (lidar.columns * source.rate_hz)
    turn = _scan(lidar).copy()
    turn["timestamp"] = ((start_ns + offset_ns) / 1e9 + turn_s)[:, None]
    points = turn.ravel()
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
