"""Header stamps inside serialised messages.

A message in CDR begins with four bytes of encapsulation, of which the second gives the byte order
(odd: little-endian). If the first field is a std_msgs/Header, its stamp follows: int32 seconds,
then uint32 nanoseconds (OMG DDS-XTypes 1.3, section 7.6.3.1.2).
"""

from __future__ import annotations

import struct

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
