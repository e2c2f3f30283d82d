"""Buffers of serialised messages, and the stamps inside them: of headers, and of transforms.

A buffer has the messages of one topic: ``NAME.cdr`` contains them one after another, ``NAME.json``
their stamps, times and sizes. The stamp is the header stamp if the type has a header, and the time
otherwise.

A tf2_msgs/TFMessage is one sequence of geometry_msgs/TransformStamped: a header (stamp and frame),
the child frame, and a transform of seven float64. In CDR (section 7.4) the sequence begins with a
uint32 count; a string is a uint32 length, including the terminating zero, and its bytes; each
primitive is aligned to its own size, relative to the end of the encapsulation::

    count | { int32 sec, uint32 nanosec, string frame, string child, 7 x float64 } ...
"""

from __future__ import annotations

import errno
import struct
from itertools import accumulate
from pathlib import Path
from typing import BinaryIO

import msgspec

from r2bspec.bags.message_types import ENCAPSULATION_BYTES, STAMP_BYTES, read_stamp
from r2bspec.ipc.sample_files import named_errors
from r2bspec.language.spec import QoS

MAX_MESSAGE_BYTES = (1 << 31) - 1
"""An entry of a playback file has a size of 32 bits."""

TF = "/tf"
TF_STATIC = "/tf_static"
TF_TYPE = "tf2_msgs/msg/TFMessage"
TF_QOS = QoS(depth=100)

_TRANSFORM_BYTES = 7 * 8


def transform_stamps(message: bytes) -> list[tuple[int, int]]:
    """Return the position of each stamp of a serialised TFMessage, and its value in ns.

    Raises:
        ValueError: the bytes are not a TFMessage.
    """
    order = "<" if len(message) > 1 and message[1] & 1 else ">"
    try:
        offsets = _stamp_offsets(message, struct.Struct(f"{order}I"))
        return [(offset, read_stamp(message, offset)) for offset in offsets]
    except struct.error as error:
        raise ValueError("a message on /tf is truncated") from error


def _stamp_offsets(message: bytes, length: struct.Struct) -> list[int]:
    """Return the offset of the stamp of each transform."""
    (count,) = length.unpack_from(message, ENCAPSULATION_BYTES)
    place = length.size
    offsets = []
    for _ in range(count):
        place = _align_up(place, 4)
        offsets.append(ENCAPSULATION_BYTES + place)
        place += 8
        for _frame in range(2):
            place = _align_up(place, 4)
            (size,) = length.unpack_from(message, ENCAPSULATION_BYTES + place)
            place += length.size + size
        place = _align_up(place, 8) + _TRANSFORM_BYTES
        if ENCAPSULATION_BYTES + place > len(message):
            raise ValueError("a message on /tf is truncated")
    return offsets


def _align_up(place: int, size: int) -> int:
    return -(-place // size) * size


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
    """Return the path of the buffer of a topic; distinct topics have distinct paths.

    ROS names contain no percent sign, so it can replace the slash.
    """
    return folder / f"{topic.strip('/').replace('/', '%')}.{suffix}"


class BufferWriter:
    """Appends messages to a buffer; `close` writes the index, without which it is incomplete."""

    def __init__(
        self, folder: Path, topic: str, type_name: str, *, has_header: bool | None
    ) -> None:
        self._folder = folder
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
            OSError: the disk is full, or the message has 2 GiB, whose size the player does not
                know; it has the name of the file.
        """
        if len(data) > MAX_MESSAGE_BYTES:
            raise OSError(errno.EFBIG, "a message has 2 GiB or more", str(self._path))
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
        write_index(self._folder, index)


def read_index(folder: Path, topic: str) -> BufferIndex:
    """Read the index of a buffer.

    Raises:
        FileNotFoundError: the buffer was not completed.
    """
    return msgspec.json.decode(buffer_path(folder, topic, "json").read_bytes(), type=BufferIndex)


def write_index(folder: Path, index: BufferIndex) -> None:
    """Write the index of a buffer, or replace it."""
    path = buffer_path(folder, index.topic, "json")
    with named_errors(path):
        path.write_bytes(msgspec.json.encode(index))


def read_stamps(folder: Path, index: BufferIndex) -> BufferIndex:
    """Return the index with the header stamps of its messages, whose type has a header."""
    stamps_ns = []
    with buffer_path(folder, index.topic, "cdr").open("rb") as file:
        for offset, size in zip(accumulate(index.sizes, initial=0), index.sizes, strict=False):
            file.seek(offset)
            stamps_ns.append(read_stamp(file.read(min(size, STAMP_BYTES))))
    return msgspec.structs.replace(index, has_header=True, stamps_ns=tuple(stamps_ns))


def read_messages(folder: Path, topic: str, wanted: set[int] | None = None) -> dict[int, bytearray]:
    """Read the messages at these positions, or all, into memory, each in a mutable buffer."""
    index = read_index(folder, topic)
    messages: dict[int, bytearray] = {}
    with buffer_path(folder, topic, "cdr").open("rb") as file:
        offsets = accumulate(index.sizes, initial=0)
        for position, (offset, size) in enumerate(zip(offsets, index.sizes, strict=False)):
            if wanted is None or position in wanted:
                file.seek(offset)
                messages[position] = bytearray(file.read(size))
    return messages


def buffered_transforms(folder: Path) -> tuple[str, ...]:
    """Return the topics of transforms that have been buffered."""
    return tuple(topic for topic in (TF, TF_STATIC) if buffer_path(folder, topic, "json").exists())


def largest_message_bytes(folder: Path) -> int:
    """Return the size of the largest message of all completed buffers; 0 if there are none."""
    sizes = (
        size
        for path in folder.glob("*.json")
        for size in msgspec.json.decode(path.read_bytes(), type=BufferIndex).sizes
    )
    return max(sizes, default=0)
