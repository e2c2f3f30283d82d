"""Sample files that one process appends to while another reads them.

A file is nothing but rows of int64, little-endian and of a fixed size. Each is appended in one
write; a reader ignores an incomplete row at the end, which a killed process may leave.
"""

from __future__ import annotations

import struct
from pathlib import Path
from typing import TYPE_CHECKING

from r2bspec.ipc.disk_errors import named_errors

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray


class RowWriter:
    """Appends rows of `width` int64 values to a new file, as ``monitor.c`` does."""

    def __init__(self, path: Path, width: int) -> None:
        self._row = struct.Struct(f"<{width}q")
        self._path = path
        self._file = path.open("xb", buffering=0)

    def append(self, *values: int) -> None:
        """Append one row.

        Raises:
            OSError: the disk is full; it has the name of the file.
        """
        with named_errors(self._path):
            self._file.write(self._row.pack(*values))

    def close(self) -> None:
        """Close the file."""
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
            return self._path.stat().st_size // self._dtype.itemsize
        except FileNotFoundError:
            return 0

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
            offset=start * self._dtype.itemsize,
        )
