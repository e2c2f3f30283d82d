"""What is played: the four workloads, as buffers that the player reads."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from r2bspec.ipc.buffers import BufferWriter

TYPE = "sensor_msgs/msg/Image"
TOPIC = "/bench/image"
COPIES = 8
"""Distinct messages in the buffer, so that the source is not always in the processor's cache."""


@dataclass(frozen=True)
class Workload:
    """Messages of one size at one rate."""

    name: str
    size: int
    rate_hz: float


SMALL, MEDIUM, LARGE = 240, 1280 * 720 * 3 + 64, 1920 * 1200 * 3 + 64

WORKLOADS = (
    Workload("240 B at 100 Hz", SMALL, 100.0),
    Workload("240 B at 1 kHz", SMALL, 1000.0),
    Workload("1280x720 rgb8 at 60 Hz", MEDIUM, 60.0),
    Workload("1920x1200 rgb8 at 60 Hz", LARGE, 60.0),
)


def message(size: int) -> Any:
    """An Image message whose serialised form has about this many bytes."""
    from sensor_msgs.msg import Image

    image = Image(height=1, encoding="rgb8")
    image.header.frame_id = "camera"
    image.data = bytes(max(0, size - 56))
    image.width, image.step = len(image.data) // 3, len(image.data)
    return image


def write_buffer(folder: Path, workload: Workload) -> None:
    """Write the buffer of a workload."""
    from rclpy.serialization import serialize_message

    data = serialize_message(message(workload.size))
    writer = BufferWriter(folder, TOPIC, TYPE, has_header=True)
    for number in range(COPIES):
        writer.append(number, data)
    writer.close()
