"""Recording a segment of a live run: the graph has its own source, and nothing is played.

A segment consists of the messages that arrived in a period of time. Their stamps are on the system
clock, all other times on CLOCK_MONOTONIC, so the offset of the two is stored with each segment.
"""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np

from r2bspec.execute.measurement.segment_observation import SegmentObservation
from r2bspec.execute.measurement.segments import SegmentHeading, SegmentPlayer
from r2bspec.record.run_record import Segment, SegmentKind
from r2bspec.record.sample_arrays import PLAYBACK_DTYPE, Rows

_POLL_S = 0.25
_MAX_CLOCK_DRIFT_NS = 1_000_000
"""A larger change of the offset within a segment means that the system clock was set."""

_CLOCK_READINGS = 5


class LiveSegmentWatcher(SegmentPlayer):
    """Records segments in which the graph's own source publishes."""

    def play_for(
        self, heading: SegmentHeading, rate_hz: float, duration_ns: int, min_steps: int = 2
    ) -> SegmentObservation:
        """Record a segment of this duration; the rate and the minimum of steps have no effect.

        Raises:
            RunError: a process exited or failed.
        """
        del rate_hz, min_steps
        heading = self._confirming(heading)
        self._progress.segment(heading.title, 0)
        first = self._first_rows()
        offset_ns = clock_offset_ns()
        began_ns = time.monotonic_ns()
        complete = False
        try:
            self._resources.sample_at(began_ns)
            live = self._live(first)
            self._wait_until(began_ns + duration_ns, lambda: self._progress.playing(live))
            self._resources.sample_at(began_ns + duration_ns)
            complete = True
        finally:
            ended_ns = began_ns + duration_ns if complete else time.monotonic_ns()
            changed_ns = clock_offset_ns() - offset_ns
            observation = self._observe_between(first, began_ns, ended_ns)
            self._write_samples(
                Segment(
                    id=heading.id,
                    kind=heading.kind,
                    rate_hz=0.0,
                    index=heading.index,
                    steps=0,
                    began_ns=began_ns,
                    ended_ns=ended_ns,
                    complete=complete,
                    rerun_of=heading.rerun_of,
                    live=True,
                    clock_offset_ns=offset_ns if abs(changed_ns) <= _MAX_CLOCK_DRIFT_NS else None,
                ),
                observation,
                first,
            )
        self._detect_stopped_outputs(heading.kind, observation)
        return observation

    def play_unrecorded(self, rate_hz: float, steps: int) -> None:
        """Let the source publish for the time that these steps would take."""
        end = time.monotonic() + steps / rate_hz
        while (left_s := end - time.monotonic()) > 0:
            self._supervisor.pump(left_s)

    def play_unrecorded_for(self, title: str, rate_hz: float, duration_ns: int) -> None:
        """Let the source publish for a time; the rate has no effect."""
        del rate_hz
        self._progress.segment(title, 0)
        self._supervisor.pump_for(duration_ns / 1e9)

    def _detect_stopped_outputs(self, kind: SegmentKind, observation: SegmentObservation) -> None:
        """Report outputs without messages, each once."""
        for plan in self._plan.monitors:
            if (
                kind == "warm_up"
                or plan.name in self._stopped_outputs
                or observation.monitors[plan.name].size
            ):
                continue
            self._stopped_outputs.add(plan.name)
            self.on_output_stopped(self.segments[-1], plan)

    def _wait_until(self, end_ns: int, report: Callable[[], None]) -> None:
        while (left_ns := end_ns - time.monotonic_ns()) > 0:
            self._supervisor.pump(min(_POLL_S, left_ns / 1e9))
            report()

    def _observe_between(
        self, first: dict[str, int], began_ns: int, ended_ns: int
    ) -> SegmentObservation:
        """The messages received between two times."""

        def within(rows: Rows) -> Rows:
            received = rows["received_ns"]
            found: Rows = rows[(received >= began_ns) & (received < ended_ns)]
            return found

        observation = self._observe(first)
        monitors = {name: within(rows) for name, rows in observation.monitors.items()}
        return SegmentObservation(self._plan, np.empty(0, PLAYBACK_DTYPE), monitors)


def clock_offset_ns() -> int:
    """The system clock minus CLOCK_MONOTONIC, from the closest of a few pairs of readings."""
    closest = None
    for _ in range(_CLOCK_READINGS):
        before_ns = time.monotonic_ns()
        system_ns = time.time_ns()
        after_ns = time.monotonic_ns()
        found = (after_ns - before_ns, system_ns - (before_ns + after_ns) // 2)
        closest = found if closest is None else min(closest, found)
    return closest[1] if closest else 0
