"""Recordings of any messages, as people have them: rates, stamps, clocks and profiles."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any, Final, Literal, NamedTuple

import numpy as np
from rosbags.interfaces import (
    Nodetype,
    Qos,
    QosDurability,
    QosHistory,
    QosLiveliness,
    QosReliability,
    QosTime,
)
from rosbags.rosbag2 import StoragePlugin, Writer

from data_bags import START_NS, typestore

SCAN: Final = "sensor_msgs/msg/LaserScan"
IMAGE: Final = "sensor_msgs/msg/Image"
IMU: Final = "sensor_msgs/msg/Imu"
POINTS: Final = "sensor_msgs/msg/PointCloud2"
MAP: Final = "nav_msgs/msg/OccupancyGrid"
TWIST: Final = "geometry_msgs/msg/Twist"
CLOCK: Final = "rosgraph_msgs/msg/Clock"
MS: Final = 1_000_000
S: Final = 1_000 * MS


_HEAD = """
import rclpy
from nav_msgs.msg import OccupancyGrid
from geometry_msgs.msg import Twist
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.qos import QoSProfile, QoSDurabilityPolicy, ReliabilityPolicy, qos_profile_sensor_data
from sensor_msgs.msg import Image, Imu, LaserScan, PointCloud2

from profiles import IMPORTED

LATCHED = QoSProfile(depth=1, durability=QoSDurabilityPolicy.TRANSIENT_LOCAL)


class Tested(Node):
    def __init__(self):
        super().__init__("tested")
        self.output = self.create_publisher(LaserScan, "output", 10)
"""
_TAIL = """
    def keep(self, message):
        self.kept = message

    def answer(self, message):
        self.send(message)

    def send(self, message):
        self.output.publish(message)
"""
_CLASSES = {SCAN: "LaserScan", IMAGE: "Image", IMU: "Imu", MAP: "OccupancyGrid", TWIST: "Twist"}
_CLASSES[POINTS] = "PointCloud2"


def node(*subscriptions: tuple[str, str, str, str], before: str = "") -> str:
    """The source of a node with subscriptions: topic, type, callback, QoS."""
    made = "".join(
        f"        self.create_subscription({_CLASSES[kind]}, '{topic}', self.{callback}, {qos})\n"
        for topic, kind, callback, qos in subscriptions
    )
    return _HEAD + before + made + _TAIL


class Recorded(NamedTuple):
    """A message: when it was recorded, and its CDR."""

    topic: str
    type: str
    time_ns: int
    data: bytes


def blank(kind: str, stamp_ns: int = 0) -> Any:
    """Return a message whose fields are empty or 0, but for its time."""
    if kind == "builtin_interfaces/msg/Time":
        return typestore().types[kind](*divmod(stamp_ns, S))
    return typestore().types[kind](
        **{name: _value(described, stamp_ns) for name, described in typestore().fielddefs[kind][1]}
    )


def _value(described: Any, stamp_ns: int) -> Any:
    node, detail = described
    if node == Nodetype.NAME:
        return blank(detail, stamp_ns)
    if node == Nodetype.BASE:
        return {"string": "", "bool": False}.get(detail[0], 0)
    (element, of), length = detail
    if element == Nodetype.BASE and of[0] != "string":
        return np.zeros(length, {"byte": "uint8", "char": "uint8"}.get(of[0], of[0]))
    return [_value((element, of), stamp_ns) for _ in range(length)]


def series(
    topic: str,
    kind: str,
    count: int,
    rate_hz: float,
    *,
    start_ns: int = START_NS,
    late_ns: int = 0,
    stamp: Callable[[int], int] = lambda time_ns: time_ns,
) -> list[Recorded]:
    """Return messages of a rate; `stamp` gives the stamp of the time of measurement."""
    rows = []
    for number in range(count):
        time_ns = start_ns + round(number * S / rate_hz)
        message = blank(kind, stamp(time_ns))
        data = bytes(typestore().serialize_cdr(message, kind))
        rows.append(Recorded(topic, kind, time_ns + late_ns, data))
    return rows


def offered(
    reliability: str = "RELIABLE", durability: str = "VOLATILE", deadline_ns: int = 0
) -> list[Qos]:
    """Return the profile of one publisher."""
    none = QosTime(0, 0)
    return [
        Qos(
            QosHistory.KEEP_LAST,
            10,
            QosReliability[reliability],
            QosDurability[durability],
            QosTime(*divmod(deadline_ns, S)),
            none,
            QosLiveliness.AUTOMATIC,
            none,
            False,
        )
    ]


def record(
    folder: Path,
    rows: Iterable[Recorded],
    profiles: Mapping[str, list[Qos]] | None = None,
    storage: Literal["sqlite3", "mcap"] = "sqlite3",
    version: Literal[8, 9] = 9,
) -> Path:
    """Write a bag, in the order of recording."""
    with Writer(folder, version=version, storage_plugin=StoragePlugin[storage.upper()]) as writer:
        connections: dict[str, Any] = {}
        for row in sorted(rows, key=lambda row: row.time_ns):
            if row.topic not in connections:
                connections[row.topic] = writer.add_connection(
                    row.topic,
                    row.type,
                    typestore=typestore(),
                    offered_qos_profiles=(profiles or {}).get(row.topic, ()),
                )
            writer.write(connections[row.topic], row.time_ns, row.data)
    return folder
