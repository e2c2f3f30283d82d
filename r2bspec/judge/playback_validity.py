"""Whether the harness did its part. Where it did not, the graph was not tested.

A graph that is offered too little, or offered its load in bursts that nobody asked for, is neither
slow nor fast: it was asked another question. What is measured at such a rate is unusable. The
criterion looks at all complete iterations of a rate together, so that one hiccup of a shared
machine in ten iterations does not spoil them:

    rate        less than 98 % of the offered rate was published
    lateness    more than 1 % of the publications began later than half a period after they were
                due, or later than 5 ms where half a period is less than that
    watching    for more than 1 % of the time the monitor had no processor, and stamped no arrival

Half a period is where a publication comes closer to its successor's time than to its own. 1 % is
the share of messages that a p99 objective turns on. 5 ms is what a busy but usable machine may
take to wake a process; at rates above 100 Hz half a period would be finer than that.

A timeline has no one rate. There the mean rate at which its steps are due stands for the offered
one, and its period for that between two steps. A live run plays nothing, and misses no schedule.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from r2bspec.measure.metric_catalogue import Statistic
from r2bspec.measure.percentiles import percentile
from r2bspec.measure.pooling import pool_playback
from r2bspec.measure.samples import RunSamples, SegmentSamples
from r2bspec.measure.units import show

MIN_RATE_SHARE = 0.98
LATE_QUANTILE = 0.99
MAX_LATE_PERIODS = 0.5
MIN_LATENESS_LIMIT_S = 0.005
MAX_UNWATCHED_SHARE = 0.01

REMEDY = "Run again on a quieter or faster machine, or offer a lower rate."
TIMELINE_REMEDY = "Run again on a quieter or faster machine, or play the recording slower."


def schedule_problem(offered_hz: float, iterations: Sequence[SegmentSamples]) -> str:
    """Why the iterations at a rate are unusable, in one sentence; empty if they are not.

    Args:
        offered_hz: the rate that was asked for; 0 for that of the recording.
        iterations: all complete iterations at it, at least one.
    """
    played = pool_playback([one.playback for one in iterations])
    if played.live:
        return ""
    planned_hz = offered_hz or played.planned_hz
    # One publication has no rate: it is neither early nor late.
    if played.sent > len(iterations) and played.rate_hz < MIN_RATE_SHARE * planned_hz:
        return (
            f"The playback reached only {show(played.rate_hz, 'Hz')} of the "
            f"{'offered' if offered_hz else 'recorded'} {show(planned_hz, 'Hz')}."
        )
    late_s = percentile(played.lateness, LATE_QUANTILE)
    allowed_s = (
        max(MAX_LATE_PERIODS / planned_hz, MIN_LATENESS_LIMIT_S)
        if planned_hz
        else MIN_LATENESS_LIMIT_S
    )
    if late_s is not None and late_s > allowed_s:
        return (
            f"More than 1 % of the publications began over {show(allowed_s, 's')} after they "
            f"were due (p99 {show(late_s, 's')})."
        )
    stalled_s = sum(one.segment.monitor_held_ns for one in iterations) / 1e9
    played_s = sum(one.segment.ended_ns - one.segment.began_ns for one in iterations) / 1e9
    if stalled_s > MAX_UNWATCHED_SHARE * played_s:
        return (
            f"The monitor had no processor for {show(stalled_s, 's')}, so that it is not "
            "known when "
            "messages arrived."
        )
    return ""


@dataclass(frozen=True)
class PlaybackValidity:
    """The offered rates at which the playback missed its schedule, and how.

    A sequential probe ends when its player cannot go on; one that held proves its rate.
    """

    iterations: Mapping[float, str]
    probes: Mapping[float, str]

    @classmethod
    def of(cls, samples: RunSamples) -> PlaybackValidity:
        """Look at the playback of all complete iterations and of the probes that did not hold."""
        played = {
            rate: schedule_problem(rate, found)
            for rate, found in samples.iterations.items()
            if found
        }
        probed = {
            probe.rate_hz: schedule_problem(probe.rate_hz, [samples.sustained[probe.rate_hz]])
            for probe in samples.record.sustained
            if not probe.holds and probe.rate_hz in samples.sustained
        }
        return cls(
            {rate: reason for rate, reason in played.items() if reason},
            {rate: reason for rate, reason in probed.items() if reason},
        )

    def problem(self, statistic: Statistic, at_hz: float | None) -> str:
        """Why what was measured for such a metric at a rate is unusable, or empty."""
        if statistic == "search" or at_hz is None:
            return ""
        found = self.probes if statistic == "sequential" else self.iterations
        return next((reason for rate, reason in found.items() if math.isclose(rate, at_hz)), "")
