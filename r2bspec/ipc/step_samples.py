"""The rows of steps whose messages are published one by one."""

from __future__ import annotations

from r2bspec.ipc.sample_files import RowWriter
from r2bspec.ipc.schedule import PlaybackEvent


class StepRows:
    """Writes one row per step, in the order in which steps begin.

    In a timeline a step may end after the next one has begun; its row is complete only then.
    """

    def __init__(self, rows: RowWriter) -> None:
        self._rows = rows
        self._open: dict[int, tuple[int, int, int]] = {}
        self._done: dict[int, tuple[int, int, int, int, int]] = {}
        self.count = 0

    def add_event(
        self, event: PlaybackEvent, stamp_ns: int, due_ns: int, published_ns: int, done_ns: int
    ) -> None:
        """Add a published event of a step."""
        if event.starts_step and event.ends_step and event.step == self.count:
            self._append(stamp_ns, due_ns, published_ns, done_ns, event.inputs)
            return
        if event.starts_step:
            self._open[event.step] = (stamp_ns, due_ns, published_ns)
        if event.ends_step:
            self._done[event.step] = (*self._open.pop(event.step), done_ns, event.inputs)
        while self.count in self._done:
            self._append(*self._done.pop(self.count))

    def _append(self, *row: int) -> None:
        self._rows.append(*row)
        self.count += 1
