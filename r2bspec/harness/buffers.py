"""Buffers: the messages of one topic, as serialised bytes, in a file and its index.

``NAME.cdr`` holds the messages one after the other, ``NAME.json`` their stamps and sizes. The
stamp is the header stamp where the type has a header and the recording time otherwise.
"""

from __future__ import annotations

from pathlib import Path
from typing import BinaryIO

import msgspec


class BufferIndex(msgspec.Struct, frozen=True, kw_only=True):
    """What is in a buffer; `stamps_ns` and `sizes` have one entry a message."""

    topic: str
    type: str
    has_header: bool
    stamps_ns: tuple[int, ...]
    sizes: tuple[int, ...]


def buffer_path(folder: Path, topic: str, suffix: str) -> Path:
    """Where the buffer of a topic is; distinct topics have distinct paths.

    ROS names hold no percent sign, so it can stand for the slash.
    """
    return folder / f"{topic.strip('/').replace('/', '%')}.{suffix}"


class BufferWriter:
    """Appends messages to a buffer. `close` writes the index, so its presence means whole."""

    def __init__(self, folder: Path, topic: str, type_name: str, *, has_header: bool) -> None:
        self._index_path = buffer_path(folder, topic, "json")
        self._topic = topic
        self._type = type_name
        self._has_header = has_header
        self._stamps: list[int] = []
        self._sizes: list[int] = []
        self._file: BinaryIO = buffer_path(folder, topic, "cdr").open("wb")

    def __len__(self) -> int:
        return len(self._sizes)

    def append(self, stamp_ns: int, data: bytes) -> None:
        """Append one serialised message.

        Raises:
            OSError: the disk is full.
        """
        self._file.write(data)
        self._stamps.append(stamp_ns)
        self._sizes.append(len(data))

    def close(self) -> None:
        """Write the index; from now on the buffer can be read."""
        self._file.close()
        index = BufferIndex(
            topic=self._topic,
            type=self._type,
            has_header=self._has_header,
            stamps_ns=tuple(self._stamps),
            sizes=tuple(self._sizes),
        )
        self._index_path.write_bytes(msgspec.json.encode(index))


def read_index(folder: Path, topic: str) -> BufferIndex:
    """Read what is in a buffer.

    Raises:
        FileNotFoundError: the buffer was never completed.
    """
    return msgspec.json.decode(buffer_path(folder, topic, "json").read_bytes(), type=BufferIndex)


def read_messages(folder: Path, topic: str, wanted: set[int]) -> dict[int, bytearray]:
    """Read the messages with these positions into memory, each in a buffer that can be patched."""
    index = read_index(folder, topic)
    messages: dict[int, bytearray] = {}
    with buffer_path(folder, topic, "cdr").open("rb") as file:
        offset = 0
        for position, size in enumerate(index.sizes):
            if position in wanted:
                file.seek(offset)
                messages[position] = bytearray(file.read(size))
            offset += size
    return messages


def largest_message_bytes(folder: Path) -> int:
    """The size of the largest message of all completed buffers; 0 if there are none."""
    sizes = (
        size
        for path in folder.glob("*.json")
        for size in msgspec.json.decode(path.read_bytes(), type=BufferIndex).sizes
    )
    return max(sizes, default=0)
