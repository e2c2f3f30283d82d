"""Small bags written for tests, and their messages decoded."""

from __future__ import annotations

import re
import sqlite3
from collections.abc import Callable, Iterable
from contextlib import closing
from functools import cache
from pathlib import Path
from typing import Any, Literal

import pytest
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from r2bspec.bags.bag_index import index_bag
from r2bspec.bags.bag_reader import read_messages
from r2bspec.bags.recording import DataError, RecordedMessage, TimeWindow

STRING = "std_msgs/msg/String"
START_NS = 1_700_000_000_000_000_000

# What the shared dataset holds: two frames of each camera, a turn of the lidar, ten readings of
# the IMU.
WINDOW = TimeWindow(start_ns=0, end_ns=50_000_000)


def refusal_of(action: Callable[..., object], *arguments: Any, **more: Any) -> DataError:
    """The error with which data is refused."""
    with pytest.raises(DataError) as refused:
        action(*arguments, **more)
    return refused.value


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


def write_mcap(
    path: Path,
    messages: Iterable[tuple[str, int, bytes]],
    *,
    profile: str = "ros2",
    encoding: str = "cdr",
    kind: str = STRING,
    **options: Any,
) -> Path:
    """Write messages of a type, or of none, with the reference library of MCAP.

    They are written in the order and with the options given.
    """
    from mcap.writer import Writer as McapWriter

    with path.open("wb") as stream:
        writer = McapWriter(stream, **options)
        writer.start(profile)
        schema = writer.register_schema(kind, "ros2msg", b"string data") if kind else 0
        channels: dict[str, int] = {}
        for topic, offset_ns, data in messages:
            if topic not in channels:
                channels[topic] = writer.register_channel(topic, encoding, schema)
            time_ns = START_NS + offset_ns
            writer.add_message(channels[topic], time_ns, data, time_ns)
        writer.finish()  # type: ignore[no-untyped-call]
    return path


def split_bag(folder: Path, parts: Iterable[list[tuple[str, int, bytes]]], **options: Any) -> Path:
    """Write a bag of several storage files, one for each list of messages."""
    import yaml

    folder.mkdir()
    merged: dict[str, Any] | None = None
    counts: dict[str, Any] = {}
    for number, part in enumerate(parts):
        single = write_bag(folder.parent / f"{folder.name}_{number}", part, **options)
        storage_file(single).rename(folder / storage_file(single).name)
        read = yaml.safe_load((single / "metadata.yaml").read_text())
        info = read["rosbag2_bagfile_information"]
        for entry in info["topics_with_message_count"]:
            known = counts.setdefault(entry["topic_metadata"]["name"], entry)
            if known is not entry:
                known["message_count"] += entry["message_count"]
        if merged is None:
            merged = info
            continue
        first = min(_start(merged), _start(info))
        last = max(_end(merged), _end(info))
        for key in ("relative_file_paths", "files", "message_count"):
            merged[key] += info[key]
        merged["starting_time"] = {"nanoseconds_since_epoch": first}
        merged["duration"] = {"nanoseconds": last - first}
    assert merged is not None
    merged["topics_with_message_count"] = list(counts.values())
    document = yaml.safe_dump({"rosbag2_bagfile_information": merged})
    (folder / "metadata.yaml").write_text(document)
    return folder


def _start(info: dict[str, Any]) -> int:
    return int(info["starting_time"]["nanoseconds_since_epoch"])


def _end(info: dict[str, Any]) -> int:
    return _start(info) + int(info["duration"]["nanoseconds"])


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


def change_storage(folder: Path, statement: str) -> None:
    """Execute a statement in the database of a bag."""
    with closing(sqlite3.connect(storage_file(folder))) as database, database:
        database.execute(statement)


def storage_file(folder: Path) -> Path:
    (found,) = [path for path in folder.iterdir() if path.suffix in {".db3", ".mcap", ".zstd"}]
    return found


@cache
def decoded(folder: Path, topic: str) -> list[tuple[RecordedMessage, Any]]:
    """Messages of a topic of a made dataset, raw and decoded; nobody changes them."""
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
