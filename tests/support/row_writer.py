"""Sample files as monitors write them."""

from __future__ import annotations

import struct
from pathlib import Path


class RowWriter:
    """Appends rows of int64 to a new file."""

    def __init__(self, path: Path, width: int) -> None:
        self._row = struct.Struct(f"<{width}q")
        self._file = path.open("xb", buffering=0)

    def append(self, *values: int) -> None:
        """Append one row in one write."""
        self._file.write(self._row.pack(*values))

    def close(self) -> None:
        """Close the file."""
        self._file.close()
