"""When an answer that has not arrived counts as lost: how long the end of a segment is waited for.

What comes after the last answer may be late: it is waited for until nothing has arrived for the
whole `drain_timeout`. A gap before an answer to the last step is most likely a loss, because graphs
rarely overtake themselves: it is waited for only for a multiple of the longest pause so far, so
that a graph that drops messages does not cost a time-out in each segment.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Literal

from r2bspec.measure.matching import NO_MATCH, MatchedMonitor

DRAIN_POLL_S = 0.01
_MIN_DRAIN_QUIET_S = 0.3
_DRAIN_PAUSE_FACTOR = 5
"""A gap is waited for so many times the longest pause between two arrivals."""
_MAX_DRAIN_S = 60.0
"""For a graph that never stops publishing, unless `drain_timeout` is longer."""

Outstanding = Literal["nothing", "gaps", "tail"]
"""The answers that are missing: none; some, but not the last; the last one, and perhaps more."""


def outstanding_answers(matched: Iterable[MatchedMonitor]) -> Outstanding:
    """Which answers are missing, over several monitors.

    As many messages as steps do not suffice: where some are answered twice, others still wait.
    """
    found: Outstanding = "nothing"
    for each in matched:
        answers = each.matching.first_row
        if not answers.size or (answers != NO_MATCH).all():
            continue
        if answers[-1] == NO_MATCH:
            return "tail"
        found = "gaps"
    return found


class DrainTimer:
    """Says when to stop waiting. Times are seconds of one monotonic clock.

    Attributes:
        outstanding: what was missing when it was last looked at; None once more has arrived.
    """

    def __init__(self, timeout_s: float, now_s: float) -> None:
        """Begin to wait after the last input; `timeout_s` is the `drain_timeout`."""
        self.outstanding: Outstanding | None = None
        self._timeout_s = timeout_s
        self._ends_at_s = now_s + max(_MAX_DRAIN_S, timeout_s)
        self._last_arrival_s = now_s
        self._longest_pause_s = 0.0
        self._arrivals = 0

    def arrived(self, now_s: float) -> None:
        """Something has arrived."""
        if self._arrivals:
            self._longest_pause_s = max(self._longest_pause_s, now_s - self._last_arrival_s)
        self._arrivals += 1
        self._last_arrival_s = now_s
        self.outstanding = None

    def wants_a_look(self, now_s: float) -> bool:
        """Whether it is time to find out what is `outstanding`, which is costly."""
        return self.outstanding is None and now_s - self._last_arrival_s > _MIN_DRAIN_QUIET_S

    def is_over(self, now_s: float) -> bool:
        """Whether what is still missing counts as lost; never before it was looked at."""
        if self.outstanding is None:
            return now_s > self._ends_at_s
        limit_s = self._timeout_s
        if self.outstanding != "tail":
            pause_s = _DRAIN_PAUSE_FACTOR * self._longest_pause_s
            limit_s = min(max(_MIN_DRAIN_QUIET_S, pause_s), self._timeout_s)
        return now_s - self._last_arrival_s > limit_s or now_s > self._ends_at_s
