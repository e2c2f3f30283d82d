"""Files of whole messages, which one process appends to and another reads when it has ended.

A message is its size (little-endian int64) and its serialised bytes.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from pathlib import Path

_SIZE = struct.Struct("<q")
_BUFFER_BYTES = 1 << 20


class MessageLogWriter:
    """Appends messages."""

    def __init__(self, path: Path) -> None:
        self._file = path.open("xb", buffering=_BUFFER_BYTES)

    def append(self, message: bytes) -> None:
        """Append one message.

        Raises:
            OSError: the disk is full.
        """
        self._file.write(_SIZE.pack(len(message)))
        self._file.write(message)

    def close(self) -> None:
        """Write what is buffered, and close."""
        self._file.close()


def read_messages(path: Path) -> Iterator[bytes]:
    """The messages of a file in their order; an incomplete last one is left out."""
    with path.open("rb", buffering=_BUFFER_BYTES) as file:
        while len(head := file.read(_SIZE.size)) == _SIZE.size:
            (size,) = _SIZE.unpack(head)
            message = file.read(size)
            if len(message) < size:
                return
            yield message
