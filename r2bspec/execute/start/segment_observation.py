"""The samples of a segment while it is played, and when the segment is over.

`SegmentObservation` has all samples at the moment they were read. An output has stopped if a pause
at the end is much longer than all pauses before it.

An answer that has not arrived counts as lost after the drain. What comes after the last answer may
be late: it is waited for until nothing has arrived for the whole `drain_timeout`. A gap before an
answer to the last step is most likely a loss, because graphs rarely overtake themselves: it is
waited for only for a multiple of the longest pause so far, so that a graph that drops messages does
not cost a time-out in each segment.

Messages that answer nothing prolong no wait: those of a timer never end. Where they carry the stamp
of the last step, no answer is to come either.
"""

from __future__ import annotations

import time
from collections.abc import Iterable
from typing import Literal

import numpy as np

from r2bspec.judge.measure.matching import (
    NO_MATCH,
    MatchedMonitor,
    Matching,
    arrivals,
    match_monitor,
)
from r2bspec.judge.measure.sample_table import monitor_samples
from r2bspec.judge.measure.samples import SegmentSamples, playback_samples
from r2bspec.plan.plan import Plan
from r2bspec.record.run_record import Segment
from r2bspec.record.sample_arrays import Rows

DRAIN_POLL_S = 0.01
_MIN_DRAIN_QUIET_S = 0.3
_DRAIN_PAUSE_FACTOR = 5
"""A gap is waited for so many times the longest pause between two arrivals."""

_MAX_DRAIN_S = 60.0
"""For a graph that never stops answering, unless `drain_timeout` is longer."""

Outstanding = Literal["nothing", "gaps", "tail"]
"""The answers that are missing: none; some, but not the last; the last one, and perhaps more."""

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

    def looked(self, now_s: float, outstanding: Outstanding, last_answer_s: float) -> None:
        """Note how many answers are missing, and when the last answer came."""
        self._last_answer_s = max(self._last_answer_s, last_answer_s)
        self._looked_s, self.outstanding = now_s, outstanding

    def is_over(self, now_s: float) -> bool:
        """Return True if missing answers count as lost; never before the first look."""
        if self.outstanding is None:
            return now_s > self._ends_at_s
        limit_s = self._timeout_s
        if self.outstanding != "tail":
            pause_s = _DRAIN_PAUSE_FACTOR * self._longest_pause_s
            limit_s = min(max(_MIN_DRAIN_QUIET_S, pause_s), self._timeout_s)
        return now_s - self._last_answer_s > limit_s or now_s > self._ends_at_s


def output_stopped(playback: Rows, rows: Rows, matching: Matching) -> bool:
    """Return True if the output stopped while messages were still expected.

    Args:
        playback: rows of type `PLAYBACK_DTYPE` of a segment.
        rows: rows of type `MONITOR_DTYPE`, all that were received until the graph was drained.
        matching: the matching of both.
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
