"""The samples of a segment while it is played, and when the segment is over.

`SegmentObservation` has all samples at the moment they were read. `ProgressView` computes the
values of a user interface on request, from the latest rows: a run without one has no cost, and a
long run no more than a short run. An output has stopped if a pause at the end is much longer than
all pauses before it.

An answer that has not arrived counts as lost after the drain. What comes after the last answer may
be late: it is waited for until nothing has arrived for the whole `drain_timeout`. A gap before an
answer to the last step is most likely a loss, because graphs rarely overtake themselves: it is
waited for only for a multiple of the longest pause so far, so that a graph that drops messages does
not cost a time-out in each segment.

Messages that answer nothing prolong no wait: those of a timer never end. Where they carry the stamp
of the last step, or none that was ever played, no answer is to come either (`UnaskedOutputs`).
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from r2bspec.ipc.playback_file import PlaybackReader
from r2bspec.ipc.sample_files import RowReader
from r2bspec.judge.measure.matching import (
    NO_MATCH,
    MatchedMonitor,
    Matching,
    arrivals,
    match_monitor,
)
from r2bspec.judge.measure.sample_table import monitor_samples
from r2bspec.judge.measure.samples import SegmentSamples, playback_samples
from r2bspec.judge.measure.times import percentile
from r2bspec.plan.plan import MonitorPlan, Plan
from r2bspec.record.run_record import Segment
from r2bspec.record.sample_arrays import Rows

DRAIN_POLL_S = 0.01
_MIN_DRAIN_QUIET_S = 0.3
_DRAIN_PAUSE_FACTOR = 5
"""A gap is waited for so many times the longest pause between two arrivals."""

_MAX_DRAIN_S = 60.0
"""For a graph that never stops answering, unless `drain_timeout` is longer."""

_MIN_UNASKED = {"stamp": 3, "order": 2}
"""So many messages that answer nothing are no chance."""

_MIN_GOING_ON = 2
_WATCHED_PERIODS = 3.5
_MIN_WATCHED = 3
_MAX_WATCH_S = 1.0

Outstanding = Literal["nothing", "gaps", "tail"]
"""The answers that are missing: none; some, but not the last; the last one, and perhaps more."""

MAX_ROWS = 10_000
"""Of the player and of each monitor; the latest."""

_MIN_MISSED = 5
"""How many expected messages must be missing at the end; fewer may be lost by chance."""

_PAUSE_FACTOR = 2.0
"""The final pause, as a multiple of the longest one before it: rare output has long pauses."""


class SegmentObservation:
    """All samples of a segment at the moment they were read."""

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
        """Return the steps that count for a monitor, and their matching with its messages."""
        if name not in self._matched:
            monitor = next(
                monitor_plan for monitor_plan in self._plan.monitors if monitor_plan.name == name
            )
            self._matched[name] = match_monitor(
                self.playback,
                self.monitors[name],
                monitor,
                self._plan.step_sources,
                self.played_before,
            )
        return self._matched[name]

    def samples(self, segment: Segment) -> SegmentSamples:
        """Return the samples in the form of metrics, without hops, processes and the host."""
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
        """Return the steps and their matching for every monitor."""
        return {name: self.matched(name) for name in self.monitors}


def outstanding_answers(matched: Iterable[MatchedMonitor]) -> Outstanding:
    """Return which answers are missing, over several monitors.

    The number of messages does not tell: if some steps are answered twice, others still wait.
    """
    outstanding: Outstanding = "nothing"
    for answer in matched:
        answers = answer.matching.first_row
        if answer.match == "any":
            # Only silence tells that no more come.
            outstanding = "gaps"
            continue
        if not answers.size or (answers != NO_MATCH).all():
            continue
        if answers[-1] == NO_MATCH and not _contains_last_step(answer):
            return "tail"
        outstanding = "gaps"
    return outstanding


def _contains_last_step(matched: MatchedMonitor) -> bool:
    """Return whether a message, though no further answer, has the stamp of the last step."""
    last = matched.steps["stamp_ns"][-1]
    return not matched.matching.by_order and bool((matched.rows["stamp_ns"] == last).any())


def last_answer_s(matched: Iterable[MatchedMonitor]) -> float:
    """Return when several monitors got their last answer (monotonic); 0 without any."""
    return max(
        (
            float(arrivals(each.rows, each.matching)[-1]) / 1e9
            for each in matched
            if each.matching.answered.any()
        ),
        default=0.0,
    )


def goes_on(matched: MatchedMonitor) -> bool:
    """Return True if messages that answer nothing have come after the last answer of a monitor."""
    last_ns = last_answer_s([matched]) * 1e9
    return int(np.count_nonzero(matched.rows["received_ns"] > last_ns)) >= _MIN_GOING_ON


class UnaskedOutputs:
    """Monitors that receive messages which no step causes, over the segments of a start.

    With matching by stamp: messages come, and none has ever had the stamp of a step. With matching
    by order: more messages come than all steps cause. No late answer of such a monitor is waited
    for.

    Args:
        was_played: which of some stamps are those of steps of earlier segments.
    """

    def __init__(self, was_played: Callable[[NDArray[np.int64]], NDArray[np.bool_]]) -> None:
        self._was_played = was_played
        self._unasked: dict[str, int] = {}
        self._answering: set[str] = set()

    def remember(self, name: str, matched: MatchedMonitor) -> None:
        """Count the messages of a segment that is over."""
        self._unasked[name] = self._count(name, matched)

    def are_all(self, name: str, matched: MatchedMonitor) -> bool:
        """Return True if the messages of a monitor, including this segment's, are all unasked."""
        least = _MIN_UNASKED["order" if matched.matching.by_order else "stamp"]
        return self._count(name, matched) >= least and name not in self._answering

    def _count(self, name: str, matched: MatchedMonitor) -> int:
        before = self._unasked.get(name, 0)
        if matched.matching.by_order:
            return before + matched.matching.surplus
        stamps = matched.rows["stamp_ns"]
        if matched.matching.answered.any() or (stamps.size and self._was_played(stamps).any()):
            self._answering.add(name)
        return before + int(stamps.size)


def watch_s(rows: Rows) -> float:
    """Return how long to watch for unasked messages: some periods of those received."""
    if rows.size < _MIN_WATCHED:
        return _MIN_DRAIN_QUIET_S
    period_s = float(np.median(np.diff(np.sort(rows["received_ns"])))) / 1e9
    return min(max(_MIN_DRAIN_QUIET_S, _WATCHED_PERIODS * period_s), _MAX_WATCH_S)


class DrainTimer:
    """Says when to stop waiting. Times are seconds of one monotonic clock.

    Attributes:
        outstanding: what was missing when it was last looked at; None once more has arrived.

    A wait begins with the last input, and anew with each answer.
    """

    def __init__(self, timeout_s: float, now_s: float) -> None:
        """Start to wait after the last input; `timeout_s` is the `drain_timeout`."""
        self.outstanding: Outstanding | None = None
        self._timeout_s = timeout_s
        self._ends_at_s = now_s + max(_MAX_DRAIN_S, timeout_s)
        self._last_arrival_s = self._looked_s = self._last_answer_s = now_s
        self._longest_pause_s = 0.0
        self._arrivals = 0
        self._goes_on = False

    def arrived(self, now_s: float) -> None:
        """Note that something has arrived."""
        if self._arrivals:
            self._longest_pause_s = max(self._longest_pause_s, now_s - self._last_arrival_s)
        self._arrivals += 1
        self._last_arrival_s = now_s
        self.outstanding = None

    def wants_a_look(self, now_s: float) -> bool:
        """Return True if it is time to determine what is `outstanding`, which is costly."""
        return self.outstanding is None and now_s - self._looked_s > _MIN_DRAIN_QUIET_S

    def looked(
        self, now_s: float, outstanding: Outstanding, last_answer_s: float, *, goes_on: bool = False
    ) -> None:
        """Note how many answers are missing, and when the last answer came.

        `goes_on`: whether messages that answer nothing have come after it.
        """
        self._last_answer_s = max(self._last_answer_s, last_answer_s)
        self._looked_s, self.outstanding, self._goes_on = now_s, outstanding, goes_on

    def is_over(self, now_s: float) -> bool:
        """Return True if missing answers count as lost; never before the first look."""
        if self.outstanding is None:
            return now_s > self._ends_at_s
        limit_s = self._timeout_s
        if self.outstanding != "tail":
            pause_s = 0.0 if self._goes_on else _DRAIN_PAUSE_FACTOR * self._longest_pause_s
            limit_s = min(max(_MIN_DRAIN_QUIET_S, pause_s), self._timeout_s)
        return now_s - self._last_answer_s > limit_s or now_s > self._ends_at_s


class ProgressView:
    """The progress of a segment.

    Args:
        playback: what the player writes.
        monitors: what each monitor writes, with its plan.
        first: how many rows each had when the segment began; the player's under an empty name.
    """

    def __init__(
        self,
        playback: PlaybackReader | RowReader,
        monitors: Mapping[str, tuple[MonitorPlan, RowReader]],
        first: Mapping[str, int],
    ) -> None:
        self._playback = _SegmentRows(playback, first[""])
        self._monitors = [
            (plan.match != "order", _SegmentRows(rows, first[name]))
            for name, (plan, rows) in monitors.items()
        ]

    def sent(self) -> int:
        """Return how many steps have been published."""
        return self._playback.count()

    def received(self) -> int:
        """Return how many messages have arrived: the minimum over all monitors."""
        return min((rows.count() for _, rows in self._monitors), default=0)

    def p99_ns(self) -> int | None:
        """Return the p99 of the latest latencies, the largest of all monitors.

        Messages that are lost or still on their way are not in it.
        """
        # Monitors first: a step that is in the monitors' rows must be in the player's.
        received = [(by_stamp, *rows.latest()) for by_stamp, rows in self._monitors]
        played_start, played = self._playback.latest()
        values = []
        for by_stamp, start, rows in received:
            shift = None if by_stamp else start - played_start
            values.append(percentile(_latencies_ns(played, rows, shift), 0.99))
        return max((int(value) for value in values if value is not None), default=None)


@dataclass
class _SegmentRows:
    """The rows of a segment, counted from its first."""

    rows: RowReader | PlaybackReader
    first: int

    def count(self) -> int:
        return self.rows.count() - self.first

    def latest(self) -> tuple[int, NDArray[np.void]]:
        """Return the latest rows, after the number of the first of them."""
        start = max(0, self.count() - MAX_ROWS)
        return start, self.rows.read(self.first + start)


def _latencies_ns(
    played: NDArray[np.void], received: NDArray[np.void], shift: int | None
) -> NDArray[np.float64]:
    """Return the latencies of received messages whose step is among those played.

    Args:
        played: rows of the player.
        received: rows of a monitor.
        shift: the step of the first message, as a row of `played`, if messages are matched by
            order; None if they are matched by stamp.
    """
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


def output_stopped(playback: Rows, rows: Rows, matching: Matching) -> bool:
    """Return True if the output stopped while messages were still expected.

    Args:
        playback: rows of type `PLAYBACK_DTYPE` of a segment.
        rows: rows of type `MONITOR_DTYPE`, all that were received until the graph was drained.
        matching: of the two.
    """
    expected_ns = playback["published_ns"][matching.trigger_steps]
    if not rows.size:
        return bool(expected_ns.size >= _MIN_MISSED)
    received_ns = np.sort(rows["received_ns"])
    last_ns = received_ns[-1]
    if np.count_nonzero(expected_ns > last_ns) < _MIN_MISSED:
        return False
    pauses_ns = np.diff(received_ns, prepend=min(received_ns[0], playback["published_ns"][0]))
    return bool(expected_ns[-1] - last_ns > _PAUSE_FACTOR * pauses_ns.max())
