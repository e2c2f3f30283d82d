"""What can be told of a segment while it is still being played.

Everything is worked out when it is asked for, from the latest rows: a run without a progress view
pays nothing for it, and a long one no more than a short one.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING

from r2bspec.ipc.playback_file import PlaybackReader
from r2bspec.ipc.sample_files import RowReader

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from r2bspec.plan.plan import MonitorPlan

MAX_ROWS = 10_000
"""Of the player and of each monitor; the latest."""


class ProgressView:
    """One segment, as far as it has been played.

    Args:
        playback: what the player writes.
        monitors: what each monitor writes, with its plan.
        first: how many rows each had when the segment began; the player's under an empty name.
        use: processor time per time of each process, by name.
    """

    def __init__(
        self,
        playback: PlaybackReader,
        monitors: Mapping[str, tuple[MonitorPlan, RowReader]],
        first: Mapping[str, int],
        use: Callable[[], Mapping[str, float]],
    ) -> None:
        self._playback = _SegmentRows(playback, first[""])
        self._monitors = [
            (plan.match == "stamp", _SegmentRows(rows, first[name]))
            for name, (plan, rows) in monitors.items()
        ]
        self._use = use

    def sent(self) -> int:
        """How many steps have been published."""
        return self._playback.count()

    def received(self) -> int:
        """How many messages have come: the least over all monitors."""
        return min((rows.count() for _, rows in self._monitors), default=0)

    def p99_ns(self) -> int | None:
        """The p99 of the latest latencies, the largest of all monitors.

        A message that is still under way is not in it, nor one that was lost.
        """
        from r2bspec.measure.times import percentile

        # Monitors first: a step that is in the monitors' rows must be in the player's.
        received = [(by_stamp, *rows.latest()) for by_stamp, rows in self._monitors]
        played_start, played = self._playback.latest()
        found = []
        for by_stamp, start, rows in received:
            shift = None if by_stamp else start - played_start
            found.append(percentile(_latencies_ns(played, rows, shift), 0.99))
        return max((int(each) for each in found if each is not None), default=None)

    def cores(self) -> Mapping[str, float]:
        """Processor time per time of each process lately; 1 is one core."""
        return self._use()


class _SegmentRows:
    """The rows of a segment, counted from its first."""

    def __init__(self, rows: RowReader | PlaybackReader, first: int) -> None:
        self._rows = rows
        self._first = first

    def count(self) -> int:
        return self._rows.count() - self._first

    def latest(self) -> tuple[int, NDArray[np.void]]:
        """The latest rows, after the number of the first of them."""
        start = max(0, self.count() - MAX_ROWS)
        return start, self._rows.read(self._first + start)


def _latencies_ns(
    played: NDArray[np.void], received: NDArray[np.void], shift: int | None
) -> NDArray[np.float64]:
    """The latencies of received messages whose step is among those played.

    Args:
        played: rows of the player.
        received: rows of a monitor.
        shift: the step of the first message, as a row of `played`, if messages are matched by
            order; None if they are matched by stamp.
    """
    import numpy as np

    if shift is None:
        # Stamps only ever grow.
        steps = np.searchsorted(played["stamp_ns"], received["stamp_ns"])
    else:
        steps = np.arange(received.size) + shift
    known = (steps >= 0) & (steps < played.size)
    if shift is None:
        known[known] = played["stamp_ns"][steps[known]] == received["stamp_ns"][known]
    times_ns = received["received_ns"][known] - played["published_ns"][steps[known]]
    return np.asarray(times_ns, np.float64)
