"""Buffers: the serialised messages of one topic in a file, with an index.

``NAME.cdr`` contains the messages one after another, ``NAME.json`` their stamps, times and sizes.
The stamp is the header stamp if the type has a header, and the time otherwise.
"""

from __future__ import annotations

from pathlib import Path
from typing import BinaryIO

import msgspec

from r2bspec.ipc.sample_files import named_errors
from r2bspec.ipc.stamps import STAMP_BYTES, TF, TF_STATIC, read_stamp


class BufferIndex(msgspec.Struct, frozen=True, kw_only=True):
    """The index of a buffer; `stamps_ns`, `sizes` and `times_ns` have one entry per message.

    `has_header` is None while it is unknown for the type. `times_ns` are the times at which the
    messages were recorded, or published by a preprocessor.
    """

    topic: str
    type: str
    has_header: bool | None
    stamps_ns: tuple[int, ...]
    sizes: tuple[int, ...]
    times_ns: tuple[int, ...]


def buffer_path(folder: Path, topic: str, suffix: str) -> Path:
    """The path of the buffer of a topic; distinct topics have distinct paths.

    ROS names contain no percent sign, so it can replace the slash.
    """
    return folder / f"{topic.strip('/').replace('/', '%')}.{suffix}"


class BufferWriter:
    """Appends messages to a buffer. `close` writes the index, so a buffer with one is complete."""

    def __init__(
        self, folder: Path, topic: str, type_name: str, *, has_header: bool | None
    ) -> None:
        self._index_path = buffer_path(folder, topic, "json")
        self._topic = topic
        self._type = type_name
        self._has_header = has_header
        self._stamps: list[int] = []
        self._sizes: list[int] = []
        self._times: list[int] = []
        self._path = buffer_path(folder, topic, "cdr")
        self._file: BinaryIO = self._path.open("wb")

    def __len__(self) -> int:
        return len(self._sizes)

    def append(self, stamp_ns: int, data: bytes, time_ns: int | None = None) -> None:
        """Append one serialised message; the default of the time is the stamp.

        Raises:
            OSError: the disk is full; it has the name of the file.
        """
        with named_errors(self._path):
            self._file.write(data)
        self._stamps.append(stamp_ns)
        self._times.append(stamp_ns if time_ns is None else time_ns)
        self._sizes.append(len(data))

    def close(self) -> None:
        """Write the index; the buffer can then be read."""
        with named_errors(self._path):
            self._file.close()
        index = BufferIndex(
            topic=self._topic,
            type=self._type,
            has_header=self._has_header,
            stamps_ns=tuple(self._stamps),
            sizes=tuple(self._sizes),
            times_ns=tuple(self._times),
        )
        _write_index(self._index_path, index)


def read_index(folder: Path, topic: str) -> BufferIndex:
    """Read the index of a buffer.

    Raises:
        FileNotFoundError: the buffer was not completed.
    """
    return msgspec.json.decode(buffer_path(folder, topic, "json").read_bytes(), type=BufferIndex)


def write_index(folder: Path, index: BufferIndex) -> None:
    """Replace the index of a buffer."""
    _write_index(buffer_path(folder, index.topic, "json"), index)


def _write_index(path: Path, index: BufferIndex) -> None:
    with named_errors(path):
        path.write_bytes(msgspec.json.encode(index))


def read_stamps(folder: Path, index: BufferIndex) -> BufferIndex:
    """The index with the header stamps of its messages, whose type has a header."""
    stamps_ns = []
    with buffer_path(folder, index.topic, "cdr").open("rb") as file:
        offset = 0
        for size in index.sizes:
            file.seek(offset)
            stamps_ns.append(read_stamp(file.read(min(size, STAMP_BYTES))))
            offset += size
    return msgspec.structs.replace(index, has_header=True, stamps_ns=tuple(stamps_ns))


def read_messages(folder: Path, topic: str, wanted: set[int]) -> dict[int, bytearray]:
    """Read the messages at these positions into memory, each in a mutable buffer."""
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


def buffered_transforms(folder: Path) -> tuple[str, ...]:
    """The topics of transforms that have been buffered."""
    return tuple(topic for topic in (TF, TF_STATIC) if buffer_path(folder, topic, "json").exists())


def largest_message_bytes(folder: Path) -> int:
    """The size of the largest message of all completed buffers; 0 if there are none."""
    sizes = (
        size
        for path in folder.glob("*.json")
        for size in msgspec.json.decode(path.read_bytes(), type=BufferIndex).sizes
    )
    return max(sizes, default=0)
