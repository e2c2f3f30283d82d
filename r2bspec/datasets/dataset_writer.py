"""Writing a bag with `rosbags`, like the recorded r2b bags."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Final

from r2bspec.bags.recording import Message, WritableStorage
from r2bspec.datasets.scene.messages import typestore

if TYPE_CHECKING:
    from rosbags.interfaces import Qos

# Version 8 is the newest that keeps QoS profiles as text, which older tools read too.
_VERSION: Final = 8
_QUEUE_DEPTH = 10


def write_bag(
    folder: Path, types: dict[str, str], messages: Iterable[Message], storage: WritableStorage
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

    plugin, mode = {
        "sqlite3": (StoragePlugin.SQLITE3, CompressionMode.MESSAGE),
        "mcap": (StoragePlugin.MCAP, CompressionMode.STORAGE),
    }[storage]
    writer = Writer(folder, version=_VERSION, storage_plugin=plugin)
    writer.set_compression(mode, CompressionFormat.ZSTD)
    with writer:
        connections = {
            topic: writer.add_connection(
                topic, kind, typestore=typestore(), offered_qos_profiles=[_offered_qos()]
            )
            for topic, kind in types.items()
        }
        for message in messages:
            writer.write(connections[message.topic], message.time_ns, message.data)


def _offered_qos() -> Qos:
    from rosbags.interfaces import (
        Qos,
        QosDurability,
        QosHistory,
        QosLiveliness,
        QosReliability,
        QosTime,
    )

    return Qos(
        history=QosHistory.KEEP_LAST,
        depth=_QUEUE_DEPTH,
        reliability=QosReliability.RELIABLE,
        durability=QosDurability.VOLATILE,
        deadline=QosTime(0, 0),
        lifespan=QosTime(0, 0),
        liveliness=QosLiveliness.AUTOMATIC,
        liveliness_lease_duration=QosTime(0, 0),
        avoid_ros_namespace_conventions=False,
    )
