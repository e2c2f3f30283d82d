"""Files of whole messages, which the monitor appends to and the controller reads in the end.

A message is its size (little-endian int64) and its serialised bytes.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from pathlib import Path

_SIZE = struct.Struct("<q")
_BUFFER_BYTES = 1 << 20


def read_messages(path: Path) -> Iterator[bytes]:
    """The messages of a file in their order; an incomplete last one is left out."""
    with path.open("rb", buffering=_BUFFER_BYTES) as file:
        while len(head := file.read(_SIZE.size)) == _SIZE.size:
            (size,) = _SIZE.unpack(head)
            message = file.read(size)
            if len(message) < size:
                return
            yield message
