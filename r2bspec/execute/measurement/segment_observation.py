"""The samples of one segment, all there is at the moment they were read."""

from __future__ import annotations

import time

from r2bspec.measure.matching import MatchedMonitor, match_monitor
from r2bspec.measure.samples import SegmentSamples, monitor_samples, playback_samples
from r2bspec.plan.plan import Plan
from r2bspec.record.run_record import Segment
from r2bspec.record.sample_arrays import Rows


class SegmentObservation:
    """The samples of one segment, all there is at the moment they were read."""

    def __init__(
        self, plan: Plan, playback: Rows, monitors: dict[str, Rows], played_before: int = 0
    ) -> None:
        self.playback = playback
        self.monitors = monitors
        self.played_before = played_before
        self.now_ns = time.monotonic_ns()
        self._plan = plan
        self._matched: dict[str, MatchedMonitor] = {}

    def matched(self, name: str) -> MatchedMonitor:
        """The steps that count for a monitor, and how its messages answer them."""
        if name not in self._matched:
            monitor = next(each for each in self._plan.monitors if each.name == name)
            self._matched[name] = match_monitor(
                self.playback,
                self.monitors[name],
                monitor,
                self._plan.inputs,
                self.played_before,
            )
        return self._matched[name]

    def samples(self, segment: Segment) -> SegmentSamples:
        """The samples as metrics need them, without hops, processes and the host."""
        return SegmentSamples(
            segment=segment,
            playback=playback_samples(self.playback),
            monitors={
                name: monitor_samples(segment, matched)
                for name, matched in self.all_matched().items()
            },
            processes={},
            machine=None,
        )

    def all_matched(self) -> dict[str, MatchedMonitor]:
        """The same of every monitor."""
        return {name: self.matched(name) for name in self.monitors}
