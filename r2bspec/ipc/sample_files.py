"""Files that one process of a run appends to while another reads them.

A sample file is nothing but rows of int64, little-endian and of a fixed size. Each is appended in
one write; a reader ignores an incomplete row at the end, which a killed process may leave.

One of them is the log of stalls. The middleware records arrivals on a thread of the monitor's
process. While this process does not run, because the machine is overloaded or the process was
stopped, no arrivals are recorded; messages then seem to arrive at the end of the stall, with a
delay that the graph did not cause.
"""

from __future__ import annotations

import contextlib
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray


@contextlib.contextmanager
def named_errors(path: Path) -> Iterator[None]:
    """Add the name of a file to errors of the system, which does not give it for an open file."""
    try:
        yield
    except OSError as error:
        if error.filename is None:
            error.filename = str(path)
        raise


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


STALL_FILE = "monitor.held"
"""A row is a round of the monitor's loop that took 100 ms longer than it waits and computes
(`r2bspec/native/monitor.c`). Even a busy machine wakes a process within some milliseconds."""

_FIELDS = (("began_ns", "<i8"), ("ended_ns", "<i8"))


class StallLogReader:
    """Reads how long the monitor was stalled; of several, in folders of their own, the worst."""

    def __init__(self, rows_dir: Path) -> None:
        further = sorted(rows_dir.glob(f"*/{STALL_FILE}"))
        self._logs = [RowReader(path, _FIELDS) for path in (rows_dir / STALL_FILE, *further)]

    def between(self, began_ns: int, ended_ns: int) -> int:
        """The total duration of stalls between two times, in ns."""
        return max(_overlap_ns(log, began_ns, ended_ns) for log in self._logs)


def _overlap_ns(log: RowReader, began_ns: int, ended_ns: int) -> int:
    overlaps = (
        min(int(row["ended_ns"]), ended_ns) - max(int(row["began_ns"]), began_ns)
        for row in log.read()
    )
    return sum(overlap for overlap in overlaps if overlap > 0)
