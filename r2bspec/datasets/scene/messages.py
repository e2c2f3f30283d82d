"""From a topic and a time to the CDR bytes of its message."""

from __future__ import annotations

from functools import lru_cache
from typing import TYPE_CHECKING, Any

from r2bspec.datasets.scene.geometry import BODY_FROM_OPTICAL, apply, transpose
from r2bspec.datasets.scene.lidar import scan
from r2bspec.datasets.scene.render import camera_pose, render_depth, render_image
from r2bspec.datasets.scene.rig import CAMERA_INFO, IMAGE, IMU, POINT_CLOUD, Camera, TopicSource
from r2bspec.datasets.scene.scenes import Scene
from r2bspec.datasets.scene.sizes import (
    CLOUD_FIELDS,
    CLOUD_POINT_BYTES,
    DISTORTION_MODEL,
    DISTORTION_TERMS,
)

if TYPE_CHECKING:
    from rosbags.typesys.store import Typestore

_DEPTH_ENCODING = "16UC1"
_MM_PER_M = 1000

# Variances of a good MEMS device, (rad/s)^2 and (m/s^2)^2; the values themselves are exact.
_GYRO_VARIANCE = 1e-6
_ACCELEROMETER_VARIANCE = 1e-4


@lru_cache(maxsize=1)
def typestore() -> Typestore:
    """The message definitions that bags are written with."""
    from rosbags.typesys import Stores, get_typestore

    return get_typestore(Stores.ROS2_JAZZY)


def render_message(scene: Scene, source: TopicSource, start_ns: int, offset_ns: int) -> bytes:
    """The message of a topic at a time.

    Args:
        scene: what is there to be seen.
        source: the topic.
        start_ns: start of the sequence, ns since the epoch.
        offset_ns: of the message, after that start; both together are its stamp.
    """
    makers = {IMAGE: _image, CAMERA_INFO: _camera_info, IMU: _imu, POINT_CLOUD: _cloud}
    message = makers[source.type](scene, source, start_ns, offset_ns)
    return bytes(typestore().serialize_cdr(message, source.type))


def _type(name: str) -> Any:
    return typestore().types[name]


def _header(source: TopicSource, time_ns: int) -> Any:
    seconds, nanoseconds = divmod(time_ns, 10**9)
    stamp = _type("builtin_interfaces/msg/Time")(sec=seconds, nanosec=nanoseconds)
    return _type("std_msgs/msg/Header")(stamp=stamp, frame_id=source.frame_id)


def _camera_of(source: TopicSource) -> Camera:
    if source.camera is None:
        msg = f"{source.name} has no camera"
        raise ValueError(msg)
    return source.camera


def _image(scene: Scene, source: TopicSource, start_ns: int, offset_ns: int) -> Any:
    import numpy as np

    camera = _camera_of(source)
    pose = camera_pose(scene.motion.pose(offset_ns / 1e9), camera)
    if camera.encoding == _DEPTH_ENCODING:
        metres = render_depth(scene.room, camera, pose)
        pixels = (metres * np.float32(_MM_PER_M) + np.float32(0.5)).astype("<u2").view(np.uint8)
    else:
        pixels = render_image(scene.room, scene.tag, camera, pose)
    return _type(IMAGE)(
        header=_header(source, start_ns + offset_ns),
        height=camera.height,
        width=camera.width,
        encoding=camera.encoding,
        is_bigendian=0,
        step=camera.width * camera.bytes_per_pixel,
        data=pixels.reshape(-1),
    )


def _camera_info(_: Scene, source: TopicSource, start_ns: int, offset_ns: int) -> Any:
    import numpy as np

    camera = _camera_of(source)
    focal, (cx, cy) = camera.focal_px, camera.center_px
    shift = -focal * camera.baseline_m
    return _type(CAMERA_INFO)(
        header=_header(source, start_ns + offset_ns),
        height=camera.height,
        width=camera.width,
        distortion_model=DISTORTION_MODEL,
        d=np.array(_distortion(camera), np.float64),
        k=np.array([focal, 0, cx, 0, focal, cy, 0, 0, 1], np.float64),
        r=np.array([1, 0, 0, 0, 1, 0, 0, 0, 1], np.float64),
        p=np.array([focal, 0, cx, shift, 0, focal, cy, 0, 0, 0, 1, 0], np.float64),
        binning_x=0,
        binning_y=0,
        roi=_type("sensor_msgs/msg/RegionOfInterest")(
            x_offset=0, y_offset=0, height=0, width=0, do_rectify=False
        ),
    )


def _distortion(camera: Camera) -> tuple[float, ...]:
    return (0.0,) * DISTORTION_TERMS if camera.lens is None else camera.lens.coefficients


def _imu(scene: Scene, source: TopicSource, start_ns: int, offset_ns: int) -> Any:
    """Rate and specific force in optical axes, as the camera's driver gives them."""
    import numpy as np

    seconds = offset_ns / 1e9
    optical_from_body = transpose(BODY_FROM_OPTICAL)
    vector = _type("geometry_msgs/msg/Vector3")
    rate = apply(optical_from_body, scene.motion.angular_velocity_rad_s(seconds))
    force = apply(optical_from_body, scene.motion.specific_force_m_s2(seconds))
    return _type(IMU)(
        header=_header(source, start_ns + offset_ns),
        orientation=_type("geometry_msgs/msg/Quaternion")(x=0.0, y=0.0, z=0.0, w=1.0),
        # -1 says that the device estimates no orientation.
        orientation_covariance=np.array([-1.0] + [0.0] * 8),
        angular_velocity=vector(*rate),
        angular_velocity_covariance=np.eye(3).ravel() * _GYRO_VARIANCE,
        linear_acceleration=vector(*force),
        linear_acceleration_covariance=np.eye(3).ravel() * _ACCELEROMETER_VARIANCE,
    )


def _cloud(scene: Scene, source: TopicSource, start_ns: int, offset_ns: int) -> Any:
    import numpy as np

    if source.lidar is None:
        msg = f"{source.name} has no lidar"
        raise ValueError(msg)
    turn_ns = 10**9 // source.rate_hz
    points = scan(scene.room, scene.motion, source.lidar, start_ns, offset_ns, turn_ns)
    field = _type("sensor_msgs/msg/PointField")
    return _type(POINT_CLOUD)(
        header=_header(source, start_ns + offset_ns),
        height=1,
        width=len(points),
        fields=[
            field(name=name, offset=offset, datatype=kind, count=1)
            for name, offset, kind in CLOUD_FIELDS
        ],
        is_bigendian=False,
        point_step=CLOUD_POINT_BYTES,
        row_step=CLOUD_POINT_BYTES * len(points),
        data=np.frombuffer(points.tobytes(), np.uint8),
        is_dense=True,
    )
