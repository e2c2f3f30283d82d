"""The progress of a segment while it is played.

Values are computed on request, and from the rows since the last request: a run without a progress
display has no cost, and a long segment costs no more per request than a short one.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING

from r2bspec.ipc.sample_files import RowReader

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from r2bspec.plan.plan import MonitorPlan

    Nanoseconds = NDArray[np.int64]


_LOG_BIN_WIDTH = math.log(1.01)
_BINS = 2800
"""Bins of 1 % from a nanosecond to about 20 minutes."""


_MAX_KEPT_STEPS = 10_000
"""The most recent steps, for which an output may still arrive."""


class ProgressView:
    """One segment, as far as it has been played.

    Args:
        playback: the rows of the player.
        monitors: the plan and the rows of each monitor.
        first: the number of rows of each at the start of the segment; of the player under an empty
            name.
        use: the CPU use of each process, in cores, by name.
    """

    def __init__(
        self,
        playback: RowReader,
        monitors: Mapping[str, tuple[MonitorPlan, RowReader]],
        first: Mapping[str, int],
        use: Callable[[], Mapping[str, float]],
    ) -> None:
        self._playback = _SampleColumns(playback, first[""])
        self._monitors = {
            name: _Latencies(plan, _SampleColumns(rows, first[name]))
            for name, (plan, rows) in monitors.items()
        }
        self._use = use

    def sent(self) -> int:
        """How many steps have been published."""
        return self._playback.count()

    def received(self) -> int:
        """How many messages have been received: the minimum over all monitors."""
        return min((each.rows.count() for each in self._monitors.values()), default=0)

    def p99_ns(self) -> int | None:
        """The p99 of the latencies of the received messages, the largest of all monitors.

        It is up to 1 % above the exact value, because latencies are counted in bins of this width.
        It does not include messages that have not been received.
        """
        # Monitors first: a step in the rows of a monitor must be in those of the player.
        for each in self._monitors.values():
            each.rows.read()
        self._playback.read()
        found = [each.p99_ns(self._playback) for each in self._monitors.values()]
        self._playback.drop(_MAX_KEPT_STEPS)
        return max((each for each in found if each is not None), default=None)

    def cores(self) -> Mapping[str, float]:
        """The recent CPU use of each process, in cores."""
        return self._use()


class _SampleColumns:
    """The rows of a segment that have been read; all but the latest may be dropped."""

    def __init__(self, rows: RowReader, first: int) -> None:
        import numpy as np

        self._rows = rows
        self._first = first
        self.dropped = 0
        self.stamps: Nanoseconds = np.empty(0, np.int64)
        self.times: Nanoseconds = np.empty(0, np.int64)

    def count(self) -> int:
        return self._rows.count() - self._first

    def read(self) -> None:
        """Read new rows: the stamps, and the times of publication or arrival."""
        import numpy as np

        new = self._rows.read(self._first + self.dropped + self.stamps.size)
        if new.size:
            names = new.dtype.names or ()
            time = "published_ns" if "published_ns" in names else "received_ns"
            self.stamps = np.concatenate((self.stamps, new["stamp_ns"]))
            self.times = np.concatenate((self.times, new[time]))

    def drop(self, kept: int) -> None:
        """Drop all but the last `kept` rows."""
        gone = max(0, self.stamps.size - kept)
        self.dropped += gone
        self.stamps, self.times = self.stamps[gone:], self.times[gone:]


class _Latencies:
    """The latencies of one monitor; each request matches only new rows."""

    def __init__(self, plan: MonitorPlan, rows: _SampleColumns) -> None:
        import numpy as np

        self.rows = rows
        self._by_stamp = plan.match == "stamp"
        self._counts: Nanoseconds = np.zeros(_BINS, np.int64)

    def p99_ns(self, playback: _SampleColumns) -> int | None:
        import numpy as np

        from r2bspec.measure.percentiles import rank

        stamps, received = self.rows.stamps, self.rows.times
        if self._by_stamp:
            # Stamps are ascending.
            steps = np.searchsorted(playback.stamps, stamps)
        else:
            steps = np.arange(stamps.size) + self.rows.dropped - playback.dropped
        known = (steps >= 0) & (steps < playback.stamps.size)
        if self._by_stamp:
            known[known] = playback.stamps[steps[known]] == stamps[known]
        new = received[known] - playback.times[steps[known]]
        self.rows.drop(0)
        steps_of = np.ceil(np.log(np.maximum(new, 1)) / _LOG_BIN_WIDTH).astype(np.int64)
        self._counts += np.bincount(np.minimum(steps_of, _BINS - 1), minlength=_BINS)
        total = int(self._counts.sum())
        if not total:
            return None
        step = int(np.searchsorted(np.cumsum(self._counts), rank(0.99, total)))
        return round(math.exp(step * _LOG_BIN_WIDTH))
