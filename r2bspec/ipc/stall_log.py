"""When the process that watches did not run: written by the monitor, read by the controller.

The middleware stamps an arrival on a thread of the monitor's process. While that process has no
processor, because the machine is overloaded or somebody stopped it, nothing is stamped, and what
arrives seems to arrive at its end: a delay that is not the graph's.
"""

from __future__ import annotations

from pathlib import Path

from r2bspec.ipc.sample_files import RowReader, RowWriter

MIN_STALL_NS = 100_000_000
"""A wait that ends so much too late was no wait. A busy machine wakes a process within some
milliseconds."""

_FILE = "monitor.held"
_FIELDS = (("began_ns", "<i8"), ("ended_ns", "<i8"))


class StallLogWriter:
    """Takes note of waits that took much longer than they should have."""

    def __init__(self, rows_dir: Path) -> None:
        self._rows = RowWriter(rows_dir / _FILE, width=2, capacity=64)

    def record_wait(self, began_ns: int, ended_ns: int, timeout_s: float) -> None:
        """A wait that was to last for at most `timeout_s` began and ended at these times."""
        if ended_ns - began_ns > timeout_s * 1e9 + MIN_STALL_NS:
            self._rows.append(began_ns, ended_ns)

    def close(self) -> None:
        """Close the file, which keeps what was noted."""
        self._rows.close()


class StallLogReader:
    """Tells how long the monitor was held up, by its own account."""

    def __init__(self, rows_dir: Path) -> None:
        self._rows = RowReader(rows_dir / _FILE, _FIELDS)

    def between(self, began_ns: int, ended_ns: int) -> int:
        """For how much of a stretch of time, in ns."""
        rows = self._rows.read()
        overlaps = (
            min(int(row["ended_ns"]), ended_ns) - max(int(row["began_ns"]), began_ns)
            for row in rows
        )
        return sum(each for each in overlaps if each > 0)
