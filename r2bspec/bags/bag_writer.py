"""Writing bags with `rosbags`, like the recorded r2b bags, and the message definitions for that."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Final

from r2bspec.bags.message_types import typestore
from r2bspec.bags.recording import RecordedMessage, WritableStorage

_NO_HASH: Final = f"RIHS01_{0:064}"
"""Of a type whose definition is not known; `rosbags` refuses an empty one."""

LATENCY_TYPE: Final = "std_msgs/msg/Float64"
"""The type of the messages with a latency, in milliseconds."""


def write_output_bag(
    folder: Path, types: dict[str, str], messages: Iterable[RecordedMessage]
) -> dict[str, int]:
    """Write a bag; returns the number of messages by topic.

    The definition of a type that is not one of ROS's own is left out: `ros2 bag` needs none where
    the type is installed.

    Args:
        folder: of the bag; must not exist.
        types: the type of each topic.
        messages: in the order of time.
    """
    from rosbags.rosbag2 import StoragePlugin, Writer

    store = typestore()
    counts = dict.fromkeys(types, 0)
    with Writer(folder, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        connections = {
            topic: writer.add_connection(topic, kind, typestore=store)
            if kind in store.fielddefs
            else writer.add_connection(topic, kind, msgdef="", rihs01=_NO_HASH)
            for topic, kind in types.items()
        }
        for message in messages:
            writer.write(connections[message.topic], message.time_ns, message.data)
            counts[message.topic] += 1
    return counts


def latency_message(latency_ns: int) -> bytes:
    """A serialised `LATENCY_TYPE`."""
    kind = typestore().types[LATENCY_TYPE]
    return bytes(typestore().serialize_cdr(kind(data=latency_ns / 1e6), LATENCY_TYPE))


OFFERED_QOS: Final = (
    "- avoid_ros_namespace_conventions: false\n"
    "  deadline: {nsec: 0, sec: 0}\n"
    "  depth: 10\n"
    "  durability: 2\n"
    "  history: 1\n"
    "  lifespan: {nsec: 0, sec: 0}\n"
    "  liveliness: 1\n"
    "  liveliness_lease_duration: {nsec: 0, sec: 0}\n"
    "  reliability: 1"
)
"""As metadata.yaml of version 8 writes reliable, keep last 10, volatile."""

# Version 8 is the newest that keeps QoS profiles as text, which older tools read too.
_DATASET_VERSION: Final = 8


def write_bag(
    folder: Path,
    types: dict[str, str],
    messages: Iterable[RecordedMessage],
    storage: WritableStorage,
) -> None:
    """Write a new bag folder.

    Args:
        folder: must not exist.
        types: message type by topic.
        messages: in time order.
        storage: sqlite3 with zstd for each message, or mcap with zstd for each chunk.

    Raises:
        OSError, sqlite3.Error: the disk is full or not writable.
    """
    from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
    from rosbags.rosbag2.metadata import parse_qos

    plugin, mode = {
        "sqlite3": (StoragePlugin.SQLITE3, CompressionMode.MESSAGE),
        "mcap": (StoragePlugin.MCAP, CompressionMode.STORAGE),
    }[storage]
    writer = Writer(folder, version=_DATASET_VERSION, storage_plugin=plugin)
    writer.set_compression(mode, CompressionFormat.ZSTD)
    with writer:
        connections = {
            topic: writer.add_connection(
                topic, kind, typestore=typestore(), offered_qos_profiles=parse_qos(OFFERED_QOS)
            )
            for topic, kind in types.items()
        }
        for message in messages:
            writer.write(connections[message.topic], message.time_ns, message.data)
