"""Writing bags with `rosbags`, like the recorded r2b bags, and the message definitions for that."""

from __future__ import annotations

from collections.abc import Iterable
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Final

from r2bspec.bags.recording import Message, WritableStorage

if TYPE_CHECKING:
    from rosbags.interfaces import Qos
    from rosbags.typesys.store import Typestore


LATENCY_TYPE: Final = "std_msgs/msg/Float64"
"""The type of the messages with a latency, in milliseconds."""


@cache
def typestore() -> Typestore:
    """The message definitions that bags are written with: those of ROS 2 Jazzy."""
    from rosbags.typesys import Stores, get_typestore

    return get_typestore(Stores.ROS2_JAZZY)


def write_output_bag(
    folder: Path, types: dict[str, str], messages: Iterable[Message]
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
            else writer.add_connection(topic, kind, msgdef="", rihs01="")
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


# Version 8 is the newest that keeps QoS profiles as text, which older tools read too.
_DATASET_VERSION: Final = 8
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
    writer = Writer(folder, version=_DATASET_VERSION, storage_plugin=plugin)
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


@cache
def begins_with_header(type_name: str) -> bool | None:
    """Whether the first field of a type is a std_msgs/Header.

    Known for every message of the ROS 2 Jazzy common interfaces, which `rosbags` ships.

    Returns:
        None for a type that is not among them.
    """
    from rosbags.interfaces import Nodetype

    fields = typestore().fielddefs.get(type_name)
    if fields is None:
        return None
    entries = fields[1]
    if not entries:
        return False
    kind, detail = entries[0][1]
    return bool(kind == Nodetype.NAME and detail == "std_msgs/msg/Header")
