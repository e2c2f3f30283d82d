"""Small bags written for tests, and their messages decoded."""

from __future__ import annotations

import re
from collections.abc import Iterable
from functools import cache
from pathlib import Path
from typing import Any, Literal

from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from r2bspec.data.model import Message, Window
from r2bspec.data.reader import read_messages

STRING = "std_msgs/msg/String"
START_NS = 1_700_000_000_000_000_000

# What the shared dataset holds: two frames of each camera, a turn of the lidar, ten readings of
# the IMU.
WINDOW = Window(start_ns=0, end_ns=50_000_000)


@cache
def typestore() -> Any:
    return get_typestore(Stores.ROS2_JAZZY)


def text(words: str) -> bytes:
    """The CDR of a std_msgs/String."""
    message = typestore().types[STRING](data=words)
    return bytes(typestore().serialize_cdr(message, STRING))


def write_bag(
    folder: Path,
    messages: Iterable[tuple[str, int, bytes]],
    *,
    storage: Literal["sqlite3", "mcap"] = "sqlite3",
    compression: Literal["none", "message", "file", "storage"] = "none",
    topics: Iterable[str] = (),
) -> Path:
    """Write strings: topic, ns after START_NS, CDR."""
    listed = list(messages)
    writer = Writer(folder, version=8, storage_plugin=StoragePlugin[storage.upper()])
    writer.set_compression(CompressionMode[compression.upper()], CompressionFormat.ZSTD)
    with writer:
        connections = {
            topic: writer.add_connection(topic, STRING, typestore=typestore())
            for topic in dict.fromkeys([*topics, *(message[0] for message in listed)])
        }
        for topic, offset_ns, data in listed:
            writer.write(connections[topic], START_NS + offset_ns, data)
    return folder


def chatter(count: int = 6) -> list[tuple[str, int, bytes]]:
    """Messages that alternate between two topics, 10 ms apart, ever longer."""
    return [
        (("/ping", "/pong")[number % 2], number * 10_000_000, text("x" * number))
        for number in range(count)
    ]


def edit_metadata(folder: Path, pattern: str, replacement: str, count: int = 0) -> None:
    path = folder / "metadata.yaml"
    before = path.read_text()
    after = re.sub(pattern, replacement, before, count=count)
    assert after != before
    path.write_text(after)


def storage_file(folder: Path) -> Path:
    (found,) = [path for path in folder.iterdir() if path.suffix in {".db3", ".mcap", ".zstd"}]
    return found


def decoded(folder: Path, topic: str) -> list[tuple[Message, Any]]:
    """Messages of a topic of a made dataset, raw and decoded."""
    from r2bspec.data.index import index_bag

    info = index_bag(folder).find(topic)
    assert info is not None
    return [
        (message, typestore().deserialize_cdr(message.data, info.type))
        for message in read_messages(folder, [topic])
    ]


def stamp_ns(message: Any) -> int:
    return int(message.header.stamp.sec) * 10**9 + int(message.header.stamp.nanosec)


def pixels(message: Any) -> Any:
    """An image as an array, (height, width[, 3])."""
    import numpy as np

    kind = {"rgb8": np.uint8, "mono8": np.uint8, "16UC1": np.dtype("<u2")}[message.encoding]
    flat = message.data.view(kind)
    shape = (message.height, message.width) + ((3,) if message.encoding == "rgb8" else ())
    return flat.reshape(shape)
