"""Writing a bag of recorded messages: MCAP, for Foxglove and ``ros2 bag``."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

LATENCY_TYPE: Final = "std_msgs/msg/Float64"
"""The type of the messages with a latency, in milliseconds."""


@dataclass(frozen=True, slots=True)
class OutputMessage:
    """One message, serialised, at a time of the system clock."""

    topic: str
    time_ns: int
    data: bytes


@contextmanager
def _writer(folder: Path) -> Iterator[Any]:
    from rosbags.rosbag2 import StoragePlugin, Writer

    with Writer(folder, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        yield writer


def write_output_bag(
    folder: Path, types: dict[str, str], messages: Iterable[OutputMessage]
) -> dict[str, int]:
    """Write a bag; returns the number of messages by topic.

    The definition of a type that is not one of ROS's own is left out: `ros2 bag` needs none where
    the type is installed.

    Args:
        folder: of the bag; must not exist.
        types: the type of each topic.
        messages: in the order of time.
    """
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_JAZZY)
    counts = dict.fromkeys(types, 0)
    with _writer(folder) as writer:
        connections = {
            topic: writer.add_connection(topic, kind, typestore=store)
            if kind in store.fielddefs
            else writer.add_connection(topic, kind, msgdef="", rihs01="")
            for topic, kind in types.items()
        }
        for each in messages:
            writer.write(connections[each.topic], each.time_ns, each.data)
            counts[each.topic] += 1
    return counts


def latency_message(latency_ns: int) -> bytes:
    """A serialised `LATENCY_TYPE`."""
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_JAZZY)
    kind = store.types[LATENCY_TYPE]
    return bytes(store.serialize_cdr(kind(data=latency_ns / 1e6), LATENCY_TYPE))
