"""Files that one process of a run appends to while another reads them.

A sample file is nothing but rows of int64, little-endian and of a fixed size. Each is appended in
one write; a reader ignores an incomplete row at the end, which a killed process may leave.

One of them is the log of stalls. The middleware records arrivals on a thread of the monitor's
process. While this process does not run, because the machine is overloaded or the process was
stopped, no arrivals are recorded; messages then seem to arrive at the end of the stall, with a
delay that the graph did not cause.

A file of whole messages has for each its size (little-endian int64) and its serialised bytes.
"""

from __future__ import annotations

import contextlib
import struct
from collections.abc import Iterator, Sequence
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


_SIZE = struct.Struct("<q")
BUFFER_BYTES = 1 << 20
"""Of reading and writing."""


HEAD_BYTES = 1 << 16
"""Of a message that a condition is about, at most: what stands first decides, and the copy of a
whole image would take time from the machine."""


def heads_path(rows_dir: Path, monitor: str) -> Path:
    """The file of the beginnings of all messages of a monitor."""
    return rows_dir / f"{monitor}.heads"


class HeadReader:
    """Reads the beginnings of messages one after the other, as a monitor goes on to write them."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._next = 0
        self._at = 0

    def pick(self, numbers: Sequence[int]) -> Iterator[bytes | None]:
        """Those of these messages, in ascending order; None for one that is not there (any more).

        None before the last of them is there later.
        """
        first = max(numbers[0], self._next) if numbers else 0
        heads = self.read(first, max(0, numbers[-1] + 1 - first)) if numbers else []
        for number in numbers:
            yield heads[number - first] if 0 <= number - first < len(heads) else None

    def read(self, first: int, count: int) -> list[bytes]:
        """Those from the message of number `first` on, none of which was read or passed before.

        Fewer, if the file does not have so many.
        """
        heads: list[bytes] = []
        with self._path.open("rb", buffering=BUFFER_BYTES) as file:
            file.seek(self._at)
            while len(heads) < count and len(size := file.read(_SIZE.size)) == _SIZE.size:
                (wanted,) = _SIZE.unpack(size)
                head = file.read(min(max(wanted, 0), HEAD_BYTES))
                if len(head) < wanted:
                    break
                if self._next >= first:
                    heads.append(head)
                self._next += 1
                self._at = file.tell()
        return heads


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
