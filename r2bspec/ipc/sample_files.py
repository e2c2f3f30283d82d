"""Files that one process of a run appends to while another reads them.

A sample file contains only rows of int64, little-endian and of a fixed size. Each row is appended
in one write; a reader ignores an incomplete row at the end, which a killed process may leave.

One of them is the log of stalls. The middleware records arrivals on a thread of the monitor's
process. While this process does not run, because the machine is overloaded or the process was
stopped, no arrivals are recorded; messages then seem to arrive at the end of the stall, with a
delay that the graph did not cause.

All times of a run are on the monotonic clock, because the system clock can be set at any time,
manually or over the network. The middleware records arrivals on the system clock. A monitor
therefore records, whenever it takes a message, the time on the monotonic clock and the difference
of the two clocks; a step of this difference tells that the system clock was set.
"""

from __future__ import annotations

import contextlib
import itertools
import struct
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray


@contextlib.contextmanager
def named_errors(path: Path) -> Iterator[None]:
    """Add the name of a file to system errors, which lack it for an open file."""
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
        """Return the number of complete rows; 0 before the file exists."""
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
    """Reads how long the monitor was stalled; with several monitors, the worst."""

    def __init__(self, rows_dir: Path) -> None:
        further = sorted(rows_dir.glob(f"*/{STALL_FILE}"))
        self._logs = [RowReader(path, _FIELDS) for path in (rows_dir / STALL_FILE, *further)]

    def between(self, began_ns: int, ended_ns: int) -> int:
        """Return the total duration of stalls between two times, in ns."""
        return max(_overlap_ns(log, began_ns, ended_ns) for log in self._logs)


def _overlap_ns(log: RowReader, began_ns: int, ended_ns: int) -> int:
    overlaps = (
        min(int(row["ended_ns"]), ended_ns) - max(int(row["began_ns"]), began_ns)
        for row in log.read()
    )
    return sum(overlap for overlap in overlaps if overlap > 0)


_MAX_READ_NS = 20_000
_MAX_READS = 5
"""The clocks are read one after the other, and again if the reads were interrupted."""

_MIN_STEP_NS = 2_000_000
_MAX_SLEW = 0.1
"""Smaller changes are not steps: the jitter of reading, and slewing of the clock by up to 10 %."""


def read_clocks(
    monotonic_ns: Callable[[], int] = time.monotonic_ns, system_ns: Callable[[], int] = time.time_ns
) -> tuple[int, int]:
    """Return the monotonic time, and the system time minus the monotonic time, in ns."""
    closest_ns, clocks = -1, (0, 0)
    for _ in range(_MAX_READS):
        before_ns = monotonic_ns()
        there_ns = system_ns()
        took_ns = monotonic_ns() - before_ns
        if closest_ns < 0 or took_ns < closest_ns:
            closest_ns = took_ns
            clocks = before_ns + took_ns, there_ns - before_ns - took_ns // 2
        if closest_ns <= _MAX_READ_NS:
            break
    return clocks


ARRIVAL_FIELDS = (
    ("stamp_ns", "<i8"),
    ("arrived_system_ns", "<i8"),
    ("taken_ns", "<i8"),
    ("bytes", "<i8"),
    ("difference_ns", "<i8"),
)
"""A row of the file (``r2bspec/native/monitor.c``). `arrived_system_ns` is 0 where the middleware
gives no time; `difference_ns` is the system time minus the monotonic time at `taken_ns`."""

_ROWS_BEFORE = 2000
"""More than the messages that can have waited for the monitor while the clock was set."""


class ArrivalReader(RowReader):
    """Reads the rows that a monitor has written so far, with times on the monotonic clock.

    Args:
        path: the path of the file.
        fields: the fields of the rows that `read` returns: ``stamp_ns``, ``received_ns``,
            ``taken_ns`` and ``bytes``.
    """

    def __init__(self, path: Path, fields: tuple[tuple[str, str], ...]) -> None:
        super().__init__(path, ARRIVAL_FIELDS)
        self._fields = fields

    def read(self, start: int = 0, stop: int | None = None) -> NDArray[np.void]:
        """Copy the rows from `start` up to `stop`, or up to the last complete one."""
        import numpy as np

        first = max(0, start - _ROWS_BEFORE)
        rows = super().read(first, stop)
        received_ns = arrival_times(rows)
        row_array = np.empty(max(0, rows.size - (start - first)), dtype=list(self._fields))
        for name in ("stamp_ns", "taken_ns", "bytes"):
            row_array[name] = rows[name][start - first :]
        row_array["received_ns"] = received_ns[start - first :]
        return row_array


def arrival_times(rows: NDArray[np.void]) -> NDArray[np.int64]:
    """Return when messages arrived, on the monotonic clock.

    A message that arrived before a step of the system clock and is taken after it has a time by the
    clock as it was: this is the later of the two possible times if it is not after the first look
    at the new clock. A message that has waited for longer than the step, and the first message of a
    file, cannot be told apart in this way; they count as having arrived after the step.

    Args:
        rows: in the order in which they were taken, with the fields `ARRIVAL_FIELDS`.

    Returns:
        One time for each row, none of them after that of taking, in ns. Without a time of the
        middleware it is the time of taking.
    """
    import numpy as np

    taken_ns, difference_ns = rows["taken_ns"], rows["difference_ns"]
    arrived_ns = rows["arrived_system_ns"] - difference_ns
    moved_ns = np.abs(np.diff(difference_ns))
    steps = 1 + np.flatnonzero(moved_ns > _MIN_STEP_NS + _MAX_SLEW * np.diff(taken_ns))
    for begin, end in itertools.pairwise([*steps.tolist(), rows.size]):
        since = slice(begin, end)
        before_ns = rows["arrived_system_ns"][since] - difference_ns[begin - 1]
        now_ns = arrived_ns[since]
        is_before = (before_ns <= taken_ns[begin]) & (
            (before_ns > now_ns) | (now_ns > taken_ns[since])
        )
        arrived_ns[since] = np.where(is_before, before_ns, now_ns)
    arrived_ns = np.where(rows["arrived_system_ns"] > 0, arrived_ns, taken_ns)
    times_ns: NDArray[np.int64] = np.minimum(arrived_ns, taken_ns)
    return times_ns
