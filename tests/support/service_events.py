"""Recordings of service introspection."""

from __future__ import annotations

import struct
from collections.abc import Iterable
from pathlib import Path

from ros_runs import START_NS

ADD_EVENTS = "/add/_service_event"
ADD_TYPE = "test_msgs/srv/BasicTypes_Event"
SENT, RECEIVED, ANSWERED = 0, 1, 2
MS = 1_000_000


def event(kind: int, *, request: bytes = b"", big_endian: bool = False) -> bytes:
    """A serialised event; without a request, as introspection of metadata publishes it."""
    order = ">" if big_endian else "<"
    info = struct.pack(f"{order}B3xiI16s4xqI", kind, 1, 2, b"client", 3, bool(request))
    return bytes([0, not big_endian, 0, 0]) + info + (request or bytes(4))


def write_events(
    folder: Path, events: Iterable[tuple[int, bytes]], topic: str = ADD_EVENTS, kind: str = ADD_TYPE
) -> Path:
    """Write a bag of events, each after its time in milliseconds; returns its folder."""
    from rosbags.rosbag2 import Writer

    with Writer(folder, version=9) as writer:
        connection = writer.add_connection(topic, kind, msgdef="", rihs01=f"RIHS01_{0:064}")
        for ms, data in events:
            writer.write(connection, START_NS + ms * MS, data)
    return folder
