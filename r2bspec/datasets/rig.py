"""The sensor rig that every sequence carries, after the r2b dataset's: a D455, a Hawk, a lidar.

Frames: the body is x forward, y left, z up; its origin is the IMU. Every camera looks along the
body's x axis; optical frames are x right, y down, z forward. Pixel (u, v) has its centre at
whole numbers, as OpenCV has it.
"""

from __future__ import annotations

import msgspec

IMAGE = "sensor_msgs/msg/Image"
CAMERA_INFO = "sensor_msgs/msg/CameraInfo"
IMU = "sensor_msgs/msg/Imu"
POINT_CLOUD = "sensor_msgs/msg/PointCloud2"


_CHANNELS = {"rgb8": 3, "mono8": 1, "16UC1": 2}


class Camera(msgspec.Struct, frozen=True):
    """A pinhole camera whose images are rectified.

    Attributes:
        frame_id: its optical frame.
        encoding: the encoding of its images.
        focal_px: the same in x and y.
        center_px: principal point (cx, cy).
        position_m: of its optical centre in the body frame.
        baseline_m: distance to the left camera of the pair; zero for any other camera.
    """

    frame_id: str
    width: int
    height: int
    encoding: str
    focal_px: float
    center_px: tuple[float, float]
    position_m: tuple[float, float, float]
    baseline_m: float = 0.0

    @property
    def bytes_per_pixel(self) -> int:
        """The size of a pixel in its encoding."""
        return _CHANNELS[self.encoding]


class Lidar(msgspec.Struct, frozen=True):
    """A spinning lidar.

    Attributes:
        elevations_deg: of its beams, from ring 0 up.
        columns: firings a turn.
    """

    frame_id: str
    elevations_deg: tuple[float, ...]
    columns: int


class TopicSource(msgspec.Struct, frozen=True):
    """A topic of a sequence and the sensor that fills it.

    Attributes:
        message_bytes: the size of every message as CDR, which is known without rendering it.
    """

    name: str
    type: str
    rate_hz: int
    message_bytes: int
    frame_id: str
    camera: Camera | None = None
    lidar: Lidar | None = None


def _infrared(side: str, y_m: float, baseline_m: float, encoding: str = "mono8") -> Camera:
    return Camera(
        frame_id=f"d455_1_{side}_ir_optical_frame",
        width=1280,
        height=720,
        encoding=encoding,
        focal_px=641.5,
        center_px=(639.25, 358.75),
        position_m=(0.02, y_m, 0.0),
        baseline_m=baseline_m,
    )


def _hawk(side: str, y_m: float, baseline_m: float) -> Camera:
    return Camera(
        frame_id=f"hawk_0_{side}_rgb_optical_frame",
        width=1920,
        height=1200,
        encoding="rgb8",
        focal_px=955.0,
        center_px=(958.5, 600.25),
        position_m=(0.03, y_m, 0.06),
        baseline_m=baseline_m,
    )


LEFT_IR = _infrared("left", 0.0475, 0.0)
RIGHT_IR = _infrared("right", -0.0475, 0.095)
# Stereo depth is computed in the left camera's view.
DEPTH = _infrared("left", 0.0475, 0.0, encoding="16UC1")
COLOUR = Camera(
    frame_id="d455_1_rgb_optical_frame",
    width=1280,
    height=800,
    encoding="rgb8",
    focal_px=639.0,
    center_px=(640.5, 399.0),
    position_m=(0.02, -0.0115, 0.0),
)
LEFT_HAWK = _hawk("left", 0.075, 0.0)
RIGHT_HAWK = _hawk("right", -0.075, 0.15)
HOPE = Camera(
    frame_id="camera_optical_frame",
    width=1920,
    height=1080,
    encoding="rgb8",
    focal_px=1390.0,
    center_px=(960.0, 540.5),
    position_m=(0.02, 0.0, 0.0),
)
IMU_FRAME = "d455_1_imu_optical_frame"
PANDAR = Lidar(
    frame_id="pandar_xt_32_0_lidar",
    elevations_deg=tuple(float(15 - ring) for ring in range(32)),
    columns=2000,
)

_CAMERA_HZ = 30
_IMU_HZ = 200
_LIDAR_HZ = 10


def _image_topics(prefix: str, camera: Camera, image_bytes: int) -> tuple[TopicSource, TopicSource]:
    frame = camera.frame_id
    return (
        TopicSource(f"{prefix}_image", IMAGE, _CAMERA_HZ, image_bytes, frame, camera),
        TopicSource(f"{prefix}_camera_info", CAMERA_INFO, _CAMERA_HZ, 381, frame, camera),
    )


ROBOT_TOPICS: tuple[TopicSource, ...] = (
    TopicSource("/d455_1_depth", IMAGE, _CAMERA_HZ, 1_843_276, DEPTH.frame_id, camera=DEPTH),
    TopicSource("/d455_1_imu", IMU, _IMU_HZ, 340, IMU_FRAME),
    *_image_topics("/d455_1_left_ir", LEFT_IR, 921_676),
    *_image_topics("/d455_1_right_ir", RIGHT_IR, 921_676),
    *_image_topics("/d455_1_rgb", COLOUR, 3_072_072),
    *_image_topics("/hawk_0_left_rgb", LEFT_HAWK, 6_912_076),
    *_image_topics("/hawk_0_right_rgb", RIGHT_HAWK, 6_912_076),
    TopicSource(
        "/pandar_xt_32_0_lidar", POINT_CLOUD, _LIDAR_HZ, 1_664_209, PANDAR.frame_id, lidar=PANDAR
    ),
)
HOPE_TOPICS: tuple[TopicSource, ...] = (
    TopicSource("/image", IMAGE, _CAMERA_HZ, 6_220_868, HOPE.frame_id, camera=HOPE),
)
# Name, offset and datatype of each field; datatypes are sensor_msgs/PointField's: 7 is float32,
# 4 is uint16, 8 is float64. The layout is the Hesai driver's, packed.
CLOUD_FIELDS: tuple[tuple[str, int, int], ...] = (
    ("x", 0, 7),
    ("y", 4, 7),
    ("z", 8, 7),
    ("intensity", 12, 7),
    ("ring", 16, 4),
    ("timestamp", 18, 8),
)
CLOUD_POINT_BYTES = 26
DISTORTION_MODEL = "plumb_bob"
DISTORTION_TERMS = 5
