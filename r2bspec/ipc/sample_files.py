"""Sample files that one process appends to while another reads them.

A file begins with a header of 64 bytes, of which the first eight are the number of complete rows
(little-endian int64); fixed-size rows of int64 follow. Rows are written before the count, so a
process that reads the first `count` rows sees only complete ones, and the rows of a killed process
can still be read.
"""

from __future__ import annotations

import mmap
import os
import struct
from pathlib import Path
from typing import TYPE_CHECKING

from r2bspec.ipc.disk_errors import named_errors

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

_HEADER_BYTES = 64
_COUNT = struct.Struct("<q")


class RowWriter:
    """Appends rows of `width` int64 values; grows the file by doubling."""

    def __init__(self, path: Path, width: int, capacity: int = 4096) -> None:
        self._row = struct.Struct(f"<{width}q")
        self._capacity = capacity
        self._count = 0
        self._path = path
        self._file = path.open("xb+")
        self._map = self._map_file(capacity)

    def _map_file(self, capacity: int) -> mmap.mmap:
        size = _HEADER_BYTES + capacity * self._row.size
        # Without the allocation, a full disk would cause SIGBUS at a later row.
        with named_errors(self._path):
            os.posix_fallocate(self._file.fileno(), 0, size)
        return mmap.mmap(self._file.fileno(), size)

    def append(self, *values: int) -> None:
        """Append one row.

        Raises:
            OSError: the disk is full; it has the name of the file.
        """
        if self._count == self._capacity:
            self._capacity *= 2
            old = self._map
            self._map = self._map_file(self._capacity)
            old.close()
        self._row.pack_into(self._map, _HEADER_BYTES + self._count * self._row.size, *values)
        self._count += 1
        _COUNT.pack_into(self._map, 0, self._count)

    def close(self) -> None:
        """Unmap and close."""
        self._map.close()
        self._file.close()


class RowReader:
    """Reads the rows that a `RowWriter`, possibly in another process, has written so far."""

    def __init__(self, path: Path, fields: tuple[tuple[str, str], ...]) -> None:
        import numpy as np

        self._path = path
        self._dtype = np.dtype(list(fields))

    def count(self) -> int:
        """The number of complete rows; 0 before the file exists."""
        try:
            with self._path.open("rb") as file:
                head = file.read(_COUNT.size)
        except FileNotFoundError:
            return 0
        return int(_COUNT.unpack(head)[0]) if len(head) == _COUNT.size else 0

    def read(self, start: int = 0, stop: int | None = None) -> NDArray[np.void]:
        """Copy the rows from `start` up to `stop`, or up to the last complete one."""
        import numpy as np

        last = self.count() if stop is None else min(stop, self.count())
        if last <= start:
            return np.empty(0, self._dtype)
        return np.fromfile(
            self._path,
            self._dtype,
            count=last - start,
            offset=_HEADER_BYTES + start * self._dtype.itemsize,
        )
