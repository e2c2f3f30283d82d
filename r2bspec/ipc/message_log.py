"""Files of whole messages, which the observer appends to and the controller reads in the end.

A message is its size (little-endian int64) and its serialised bytes.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from pathlib import Path

_SIZE = struct.Struct("<q")
BUFFER_BYTES = 1 << 20
"""Of reading and writing."""


def message_size(data: bytes) -> bytes:
    """What is written before a message."""
    return _SIZE.pack(len(data))


def read_messages(path: Path) -> Iterator[bytes]:
    """The messages of a file in their order; an incomplete last one is left out."""
    with path.open("rb", buffering=BUFFER_BYTES) as file:
        while len(head := file.read(_SIZE.size)) == _SIZE.size:
            (size,) = _SIZE.unpack(head)
            message = file.read(size)
            if len(message) < size:
                return
            yield message
