"""Facts about message types, and the stamps of their messages, without ROS.

A message in CDR begins with four bytes of encapsulation, of which the second gives the byte order
(odd: little-endian). If the first field is a std_msgs/Header, its stamp follows: int32 seconds,
then uint32 nanoseconds (OMG DDS-XTypes 1.3, section 7.6.3.1.2).

The types that most graphs use are listed here, because loading `rosbags`, which has all types of
the common interfaces, takes longer than the rest of a check.
"""

from __future__ import annotations

import struct
from functools import cache
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from rosbags.typesys.store import Typestore

WITH_HEADER = frozenset(
    {
        "diagnostic_msgs/msg/DiagnosticArray",
        "geometry_msgs/msg/PointStamped",
        "geometry_msgs/msg/PoseArray",
        "geometry_msgs/msg/PoseStamped",
        "geometry_msgs/msg/PoseWithCovarianceStamped",
        "geometry_msgs/msg/TransformStamped",
        "geometry_msgs/msg/TwistStamped",
        "nav_msgs/msg/OccupancyGrid",
        "nav_msgs/msg/Odometry",
        "nav_msgs/msg/Path",
        "sensor_msgs/msg/CameraInfo",
        "sensor_msgs/msg/CompressedImage",
        "sensor_msgs/msg/Image",
        "sensor_msgs/msg/Imu",
        "sensor_msgs/msg/JointState",
        "sensor_msgs/msg/LaserScan",
        "sensor_msgs/msg/NavSatFix",
        "sensor_msgs/msg/PointCloud2",
        "stereo_msgs/msg/DisparityImage",
    }
)
"""Frequent types that begin with a std_msgs/Header."""

WITHOUT_HEADER = frozenset(
    {
        "geometry_msgs/msg/Pose",
        "geometry_msgs/msg/Twist",
        "std_msgs/msg/Bool",
        "std_msgs/msg/Float32",
        "std_msgs/msg/Float64",
        "std_msgs/msg/Int32",
        "std_msgs/msg/String",
        "tf2_msgs/msg/TFMessage",
    }
)
"""Frequent types without a header."""


ENCAPSULATION_BYTES: Final = 4
_STAMP: Final = {"little": struct.Struct("<iI"), "big": struct.Struct(">iI")}
STAMP_BYTES: Final = ENCAPSULATION_BYTES + _STAMP["little"].size
"""The number of bytes at the beginning of a message that contain its stamp."""
_SECOND_NS: Final = 1_000_000_000


def read_stamp(message: bytes | bytearray, offset: int = ENCAPSULATION_BYTES) -> int:
    """Return the stamp in ns, by default the header stamp of a type that begins with a header.

    Raises:
        struct.error: the message is too short.
        IndexError: it has no encapsulation.
    """
    stamp = _STAMP["little" if message[1] & 1 else "big"]
    seconds, nanoseconds = stamp.unpack_from(message, offset)
    return int(seconds) * _SECOND_NS + int(nanoseconds)


@cache
def typestore() -> Typestore:
    """Return the message definitions of the common interfaces of ROS 2 Jazzy."""
    from rosbags.typesys import Stores, get_typestore

    return get_typestore(Stores.ROS2_JAZZY)


@cache
def begins_with_header(name: str) -> bool | None:
    """Return True if the first field of a type is a std_msgs/Header; None if unknown."""
    if name in WITH_HEADER:
        return True
    if name in WITHOUT_HEADER:
        return False
    from rosbags.interfaces import Nodetype

    fields = typestore().fielddefs.get(name)
    if fields is None:
        return None
    kind, detail = fields[1][0][1] if fields[1] else (None, None)
    return bool(kind == Nodetype.NAME and detail == "std_msgs/msg/Header")


def types_of_same_package(name: str) -> frozenset[str]:
    """Return all types of the package of `name`, if it is a common package, else none."""
    if name in WITH_HEADER or name in WITHOUT_HEADER:
        return frozenset({name})
    package = name.partition("/")[0]
    return frozenset(common for common in common_types() if common.partition("/")[0] == package)


@cache
def common_types() -> frozenset[str]:
    """Return every message type of the common interfaces of ROS 2 Jazzy, which `rosbags` ships."""
    return frozenset(typestore().fielddefs)
