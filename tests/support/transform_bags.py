"""Bags with transforms, and the environment in which tests can play them."""

from __future__ import annotations

import importlib.util
import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from rosbags.rosbag2 import Writer

from r2bspec.bags.message_types import typestore
from r2bspec.native.build import build, find_ros
from ros_runs import IMAGE, START_NS, image

TF_TYPE = "tf2_msgs/msg/TFMessage"
MS = 1_000_000
_STAND_IN = Path(__file__).with_name("without_tf2")


def transforms(*found: tuple[str, str, int], big_endian: bool = False) -> bytes:
    """A serialised TFMessage of (frame, child, stamp in ns)."""
    types = typestore().types
    made = []
    for number, (frame, child, stamp_ns) in enumerate(found):
        stamp = types["builtin_interfaces/msg/Time"](*divmod(stamp_ns, 10**9))
        header = types["std_msgs/msg/Header"](stamp, frame)
        translation = types["geometry_msgs/msg/Vector3"](1.0 + number, 2.0, 3.0)
        rotation = types["geometry_msgs/msg/Quaternion"](0.0, 0.0, 0.0, 1.0)
        transform = types["geometry_msgs/msg/Transform"](translation, rotation)
        made.append(types["geometry_msgs/msg/TransformStamped"](header, child, transform))
    message = types[TF_TYPE](made)
    return bytes(typestore().serialize_cdr(message, TF_TYPE, little_endian=not big_endian))


def read_transforms(data: bytes) -> list[tuple[str, str, int]]:
    """What `transforms` was given."""
    message: Any = typestore().deserialize_cdr(data, TF_TYPE)
    return [
        (
            transform.header.frame_id,
            transform.child_frame_id,
            transform.header.stamp.sec * 10**9 + transform.header.stamp.nanosec,
        )
        for transform in message.transforms
    ]


def write_transform_bag(
    folder: Path,
    images_ms: Sequence[int],
    tf_ms: Sequence[int],
    static: Sequence[tuple[str, str]],
) -> Path:
    """A bag of images, of /tf with two transforms a message, and of /tf_static, one a message.

    The second transform of a message is stamped 2 ms before the first.
    """
    with Writer(folder, version=9) as writer:
        camera = writer.add_connection("/camera", IMAGE, typestore=typestore())
        tf = writer.add_connection("/tf", TF_TYPE, typestore=typestore())
        latched = writer.add_connection("/tf_static", TF_TYPE, typestore=typestore())
        rows = [(START_NS + at * MS, camera, image(at, START_NS + at * MS)) for at in images_ms]
        for at in tf_ms:
            stamp_ns = START_NS + at * MS
            pair = ("map", "odom", stamp_ns), ("odom", "base", stamp_ns - 2 * MS)
            rows.append((stamp_ns, tf, transforms(*pair)))
        for number, (frame, child) in enumerate(static):
            rows.append((START_NS + number, latched, transforms((frame, child, START_NS))))
        for time_ns, connection, data in sorted(rows, key=lambda row: row[0]):
            writer.write(connection, time_ns, data)
    return folder


def with_tf2() -> dict[str, str]:
    """Changes to the environment in which tf2_msgs can be imported, and loaded by programs in C."""
    if importlib.util.find_spec("tf2_msgs") is not None:
        return {}
    library = build(
        "libtf2_msgs__rosidl_typesupport_c.so",
        [_STAND_IN / "tf2_msgs_type.c"],
        find_ros(),
        kind="library",
        libraries=("-lgeometry_msgs__rosidl_typesupport_c",),
    )
    return {
        name: os.pathsep.join([str(folder), os.environ.get(name, "")])
        for name, folder in (("PYTHONPATH", _STAND_IN), ("LD_LIBRARY_PATH", library.parent))
    }
