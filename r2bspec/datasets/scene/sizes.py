"""How many bytes a rendered message takes in CDR, without rendering it.

CDR aligns every number to its own size, counted from after the 4 bytes of encapsulation;
strings and sequences carry a 4-byte length, strings a closing zero.
"""

from __future__ import annotations

from r2bspec.datasets.scene.rig import CAMERA_INFO, IMAGE, IMU, POINT_CLOUD, TopicSource

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


class _CdrSize:
    """A position in a CDR stream."""

    def __init__(self) -> None:
        self.bytes = 0

    def numbers(self, count: int, size: int) -> None:
        if count:
            self.bytes += -self.bytes % size + count * size

    def string(self, text: str) -> None:
        self.numbers(1, 4)
        self.bytes += len(text.encode()) + 1

    def header(self, frame_id: str) -> None:
        self.numbers(2, 4)
        self.string(frame_id)


def message_bytes(source: TopicSource) -> int:
    """Size of every message of a topic in bytes, with the encapsulation."""
    count = _CdrSize()
    count.header(source.frame_id)
    if source.type == IMAGE and source.camera is not None:
        pixels = source.camera.width * source.camera.height
        count.numbers(2, 4)
        count.string(source.camera.encoding)
        count.numbers(1, 1)
        count.numbers(2, 4)
        count.numbers(pixels * source.camera.bytes_per_pixel, 1)
    elif source.type == CAMERA_INFO:
        count.numbers(2, 4)
        count.string(DISTORTION_MODEL)
        count.numbers(1, 4)
        count.numbers(DISTORTION_TERMS + 9 + 9 + 12, 8)
        count.numbers(2 + 4, 4)
        count.numbers(1, 1)
    elif source.type == IMU:
        count.numbers(4 + 9 + 3 + 9 + 3 + 9, 8)
    elif source.type == POINT_CLOUD and source.lidar is not None:
        points = source.lidar.columns * len(source.lidar.elevations_deg)
        count.numbers(3, 4)
        for name, _, _ in CLOUD_FIELDS:
            count.string(name)
            count.numbers(1, 4)
            count.numbers(1, 1)
            count.numbers(1, 4)
        count.numbers(1, 1)
        count.numbers(3, 4)
        count.numbers(points * CLOUD_POINT_BYTES + 1, 1)
    else:
        msg = f"no size is known for {source.type}"
        raise ValueError(msg)
    return 4 + count.bytes
