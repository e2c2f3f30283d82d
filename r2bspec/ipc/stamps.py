"""Stamps inside serialised messages: of headers, and of transforms.

A message in CDR begins with four bytes of encapsulation, of which the second gives the byte order
(odd: little-endian). If the first field is a std_msgs/Header, its stamp follows: int32 seconds,
then uint32 nanoseconds (OMG DDS-XTypes 1.3, section 7.6.3.1.2).

A tf2_msgs/TFMessage is one sequence of geometry_msgs/TransformStamped: a header (stamp and frame),
the child frame, and a transform of seven float64. In CDR (section 7.4) the sequence begins with a
uint32 count; a string is a uint32 length, including the terminating zero, and its bytes; each
primitive is aligned to its own size, relative to the end of the encapsulation::

    count | { int32 sec, uint32 nanosec, string frame, string child, 7 x float64 } ...
"""

from __future__ import annotations

import struct

from r2bspec.language.spec import QoS

_LITTLE = struct.Struct("<iI")
_BIG = struct.Struct(">iI")
_ENCAPSULATION_BYTES = 4
STAMP_BYTES = _ENCAPSULATION_BYTES + _LITTLE.size
"""The number of bytes at the beginning of a message that contain its stamp."""

_SECOND_NS = 1_000_000_000


def read_stamp(message: bytes | bytearray) -> int:
    """The header stamp in nanoseconds, of a message whose type begins with a header.

    Raises:
        struct.error: the message is too short.
    """
    layout = _LITTLE if message[1] & 1 else _BIG
    seconds, nanoseconds = layout.unpack_from(message, _ENCAPSULATION_BYTES)
    return int(seconds) * _SECOND_NS + int(nanoseconds)


def write_stamp(message: bytearray, stamp_ns: int) -> None:
    """Replace the header stamp, in place."""
    layout = _LITTLE if message[1] & 1 else _BIG
    layout.pack_into(message, _ENCAPSULATION_BYTES, *divmod(stamp_ns, _SECOND_NS))


TF = "/tf"
TF_STATIC = "/tf_static"
TF_TYPE = "tf2_msgs/msg/TFMessage"
TF_QOS = QoS(depth=100)

_TRANSFORM_BYTES = 7 * 8


class StampedTransforms:
    """One serialised TFMessage in memory, whose stamps can be shifted repeatedly.

    Raises:
        ValueError: the bytes are not a TFMessage.
    """

    def __init__(self, message: bytearray) -> None:
        order = "<" if len(message) > 1 and message[1] & 1 else ">"
        self._stamp = struct.Struct(f"{order}iI")
        self._message = message
        try:
            self._offsets = _stamp_offsets(message, struct.Struct(f"{order}I"))
            self.stamps_ns = tuple(map(self._read, self._offsets))
        except struct.error as error:
            raise ValueError("a message on /tf is truncated") from error

    def shift(self, by_ns: int) -> None:
        """Write the original stamps of the message plus `by_ns`, in place."""
        for offset, stamp_ns in zip(self._offsets, self.stamps_ns, strict=True):
            self._stamp.pack_into(self._message, offset, *divmod(stamp_ns + by_ns, _SECOND_NS))

    def places(self) -> list[tuple[int, int]]:
        """Where each stamp is in the message, and its original value in ns."""
        return list(zip(self._offsets, self.stamps_ns, strict=True))

    def _read(self, offset: int) -> int:
        seconds, nanoseconds = self._stamp.unpack_from(self._message, offset)
        return int(seconds) * _SECOND_NS + int(nanoseconds)


def _stamp_offsets(message: bytearray, length: struct.Struct) -> list[int]:
    """The offset of the stamp of each transform."""
    (count,) = length.unpack_from(message, _ENCAPSULATION_BYTES)
    place = length.size
    offsets = []
    for _ in range(count):
        place = _align_up(place, 4)
        offsets.append(_ENCAPSULATION_BYTES + place)
        place += 8
        for _frame in range(2):
            place = _align_up(place, 4)
            (size,) = length.unpack_from(message, _ENCAPSULATION_BYTES + place)
            place += length.size + size
        place = _align_up(place, 8) + _TRANSFORM_BYTES
        if _ENCAPSULATION_BYTES + place > len(message):
            raise ValueError("a message on /tf is truncated")
    return offsets


def _align_up(place: int, size: int) -> int:
    return -(-place // size) * size
