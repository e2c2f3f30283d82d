"""Recordings of every format, played on real ROS: every message that was recorded comes out."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("rclpy")

from mcap.writer import Writer as McapWriter
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from ros_runs import IMAGE, START_NS, STRING, Bench, quick_input, relay_node, relay_spec

COUNT = 6
STEP_NS = 33_000_000
STORE = get_typestore(Stores.ROS2_JAZZY)


def image(number: int) -> Any:
    """An image that is stamped with the time at which it is recorded."""
    types = STORE.types
    stamp = types["builtin_interfaces/msg/Time"](*divmod(START_NS + number * STEP_NS, 10**9))
    header = types["std_msgs/msg/Header"](stamp, "camera")
    pixels = np.full(12, number, np.uint8)
    return types[IMAGE](header, 2, 2, "rgb8", 0, 6, pixels)


def cdr(number: int, *, little_endian: bool = True) -> bytes:
    return bytes(STORE.serialize_cdr(image(number), IMAGE, little_endian=little_endian))


def _rosbag2(folder: Path, storage: str, mode: str = "NONE", *, little_endian: bool = True) -> Path:
    writer = Writer(folder, version=8, storage_plugin=StoragePlugin[storage])
    writer.set_compression(CompressionMode[mode], CompressionFormat.ZSTD)
    with writer:
        connection = writer.add_connection(f"/{folder.name}", IMAGE, typestore=STORE)
        for number in range(COUNT):
            data = cdr(number, little_endian=little_endian)
            writer.write(connection, START_NS + number * STEP_NS, data)
    return folder


def _unordered_mcap(folder: Path) -> Path:
    path = folder.with_suffix(".mcap")
    with path.open("wb") as stream:
        writer = McapWriter(stream, use_chunking=False)
        writer.start("ros2")
        schema = writer.register_schema(IMAGE, "ros2msg", b"")
        channel = writer.register_channel(f"/{folder.name}", "cdr", schema)
        for number in (0, 2, 1, 5, 4, 3):
            time_ns = START_NS + number * STEP_NS
            writer.add_message(channel, time_ns, cdr(number), time_ns)
        writer.finish()  # type: ignore[no-untyped-call]
    return path


FORMATS: dict[str, Callable[[Path], Path]] = {
    "by_message": lambda at: _rosbag2(at, "SQLITE3", "MESSAGE"),
    "by_file": lambda at: _rosbag2(at, "MCAP", "FILE"),
    "big_endian": lambda at: _rosbag2(at, "SQLITE3", little_endian=False),
    "unordered": _unordered_mcap,
}


def relays(
    bags: list[str], topics: dict[str, str], kinds: dict[str, str], match: str
) -> dict[str, Any]:
    """A spec that plays topics, by the names of their relays, which share a process."""
    return relay_spec(
        transport="udp",
        data_loader={
            "bags": bags,
            "topics": {topic: f"loaded/{name}" for name, topic in topics.items()},
        },
        playback={
            "buffer": 0,
            "inputs": {
                f"in/{name}": quick_input(f"loaded/{name}", kind) for name, kind in kinds.items()
            },
        },
        graph={
            "placement": "shared",
            "nodes": {
                name: relay_node(
                    parameters={"format": kind, "queue_depth": 100},
                    remappings={"input": f"in/{name}", "output": f"out/{name}"},
                )
                for name, kind in kinds.items()
            },
        },
        monitors={
            name: {"topic": f"out/{name}", "format": kind, "match": match}
            for name, kind in kinds.items()
        },
    )


def test_every_message_of_every_format_goes_through(tmp_path: Path) -> None:
    """One run that plays a recording of each format, each through a relay of its own."""
    bench = Bench(tmp_path / "formats")
    bags = [f"./{make(bench.folder / name).name}" for name, make in FORMATS.items()]
    topics = {name: f"/{name}" for name in FORMATS}
    done = bench.run(relays(bags, topics, dict.fromkeys(FORMATS, IMAGE), "stamp"))
    done.assert_complete()
    run = done.run()
    names = {process.name for process in run.record.processes}
    assert names == {"harness.observer", "player", "graph", "monitor"}
    (segment,) = done.segments()
    sent = sorted(run.playback(segment)["stamp_ns"])
    assert len(sent) == segment.steps
    for name in FORMATS:
        assert sorted(run.monitor(segment, name)["stamp_ns"]) == sent, name


RECORDED = {
    "split": ("wbag", "AAA", STRING),
    "strings": ("convert_b_mcap", "c_strings", "test_msgs/msg/Strings"),
    "arrays": ("cdr_test", "/array_topic", "test_msgs/msg/Arrays"),
    "basic": ("seek_mcap", "topic1", "test_msgs/msg/BasicTypes"),
    "talk": ("talker", "/topic", STRING),
}


def test_recordings_of_others_are_played(tmp_path: Path, real_bags: Path) -> None:
    pytest.importorskip("test_msgs.msg")
    bags = [f"{real_bags}/{bag}" for bag, _, _ in RECORDED.values()]
    topics = {name: topic for name, (_, topic, _) in RECORDED.items()}
    kinds = {name: kind for name, (_, _, kind) in RECORDED.items()}
    done = Bench(tmp_path).run(relays(bags, topics, kinds, "order"))
    done.assert_complete()
    (segment,) = done.segments()
    counts = {name: done.run().monitor(segment, name).size for name in RECORDED}
    assert counts == dict.fromkeys(RECORDED, segment.steps)
