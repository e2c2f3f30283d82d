"""Writing bags with `rosbags`, like the recorded r2b bags, and the message definitions for that."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Final

from r2bspec.bags.message_types import typestore
from r2bspec.bags.recording import RecordedMessage, WritableStorage

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
