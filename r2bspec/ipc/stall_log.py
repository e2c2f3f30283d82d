"""Times at which the monitor was stalled: written by the monitor, read by the controller.

The middleware records arrivals on a thread of the monitor's process. While this process does not
run, because the machine is overloaded or the process was stopped, no arrivals are recorded;
messages then seem to arrive at the end of the stall, with a delay that the graph did not cause.
"""

from __future__ import annotations

from pathlib import Path

from r2bspec.ipc.sample_files import RowReader

STALL_FILE = "monitor.held"
"""A row is a round of the monitor's loop that took 100 ms longer than it waits and computes
(`r2bspec/native/monitor.c`). Even a busy machine wakes a process within some milliseconds."""

_FIELDS = (("began_ns", "<i8"), ("ended_ns", "<i8"))


class StallLogReader:
    """Reads how long the monitor was stalled; of several, in folders of their own, the worst."""

    def __init__(self, rows_dir: Path) -> None:
        further = sorted(rows_dir.glob(f"*/{STALL_FILE}"))
        self._logs = [RowReader(each, _FIELDS) for each in (rows_dir / STALL_FILE, *further)]

    def between(self, began_ns: int, ended_ns: int) -> int:
        """The total duration of stalls between two times, in ns."""
        return max(_overlap_ns(each, began_ns, ended_ns) for each in self._logs)


def _overlap_ns(log: RowReader, began_ns: int, ended_ns: int) -> int:
    overlaps = (
        min(int(row["ended_ns"]), ended_ns) - max(int(row["began_ns"]), began_ns)
        for row in log.read()
    )
    return sum(each for each in overlaps if each > 0)
