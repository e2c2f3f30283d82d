"""Results that are invalid: impossible values, and measurements under another load.

Impossible results
------------------

    early      more than 1 % of the answers were received before their input was published
    surplus    by order, more than 1 % more outputs than the monitor's ratio allows

1 % is the share of messages that decides a p99 objective, and one message of another origin in a
hundred is no reason to discard a run. By order, an early output means that it answers another
input than the one it is matched to, and a surplus means that it is unknown which one it answers.
By stamp, it means that the times or the stamps are wrong.

Throughput cannot be more than offered times answered: see `r2bspec.judge.measure.times`.

The schedule of the harness
---------------------------

Where the harness did not keep its schedule, the graph was not tested.

A graph that was offered too little, or its load in bursts that the spec does not have, was tested
under another load. What is measured at such a rate is invalid. The criterion takes all complete
iterations of a rate together, so that one short stall of a shared machine in ten iterations does
not invalidate them:

    rate        less than 98 % of the offered rate was published
    lateness    more than 1 % of the publications began later than half a period after they were
                due; at more than 100 Hz, later than 5 ms or 1.5 periods, whichever is less
    stalled     for more than 1 % of the time the monitor had no processor, and could not stamp
                arrivals

From half a period on a publication is closer to its successor's time than to its own. 1 % is the
share of messages that decides a p99 objective. 5 ms is what a busy but usable machine may take to
wake a process; at rates above 100 Hz half a period would be less than that. A publication that is
1.5 periods late is closer to the time of the second one after it: at least two go out at once, and
the graph is offered bursts. So 1.5 periods are too late at every rate: 1.5 ms at 1 kHz.

A timeline has no single rate: the mean rate at which its steps are due replaces the offered one,
and likewise with arrivals that are not at equal intervals, of which the period is the mean one. A
live run plays nothing, and misses no schedule.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from r2bspec.judge.measure.metric import Statistic
from r2bspec.judge.measure.own_pace import own_pace_text
from r2bspec.judge.measure.sample_table import MonitorSamples
from r2bspec.judge.measure.samples import RunSamples, SegmentSamples, pool_playback
from r2bspec.judge.measure.times import percentile
from r2bspec.judge.measure.units import show

MAX_IMPOSSIBLE_SHARE = 0.01


@dataclass(frozen=True)
class Problem:
    """Why results are invalid, in one sentence, and a remedy, in another."""

    reason: str
    remedy: str


def impossible_result(iterations: Sequence[SegmentSamples]) -> Problem | None:
    """Return what is impossible in the iterations at a rate; None if nothing is.

    Args:
        iterations: all complete iterations at it, at least one.
    """
    if iterations[0].live:
        return None
    for name in iterations[0].monitors:
        seen = MonitorSamples.joined([iteration.monitors[name] for iteration in iterations])
        reason = _surplus(name, seen) or _early(name, seen)
        if reason is not None:
            return reason
    return None


def _early(name: str, seen: MonitorSamples) -> Problem | None:
    if seen.early <= MAX_IMPOSSIBLE_SHARE * seen.answered:
        return None
    counts = f"{show(seen.early, 'count')} of {show(seen.answered, 'count')} outputs"
    reason = (
        f"At monitor '{name}', {counts} were received before their input was published, which is "
        "impossible"
    )
    if seen.by_order:
        return Problem(
            f"{reason}: matched by order, they answer other inputs.",
            "Match by stamp, or set the ratio of the monitor to what its node publishes.",
        )
    return Problem(
        f"{reason}: their stamps or the times of their reception are wrong.",
        "Use outputs that keep the stamp of their input, or another middleware.",
    )


def _surplus(name: str, seen: MonitorSamples) -> Problem | None:
    if seen.surplus <= MAX_IMPOSSIBLE_SHARE * seen.expected:
        return None
    received = show(seen.expected + seen.surplus, "count")
    remedy = "Set the ratio of the monitor to what its node publishes, or match by stamp."
    text = seen.fitting_match
    if seen.own_period_s is not None:
        text = own_pace_text(seen.own_period_s)
    if text:
        remedy = f"{text[0].upper()}{text[1:]}"
    return Problem(
        f"Monitor '{name}' received {received} outputs for {show(seen.sent, 'count')} inputs, and "
        f"its ratio allows {show(seen.expected, 'count')}: which input each of them answers is "
        "unknown.",
        remedy,
    )


MIN_RATE_SHARE = 0.98
LATE_QUANTILE = 0.99
MAX_LATE_PERIODS = 0.5
MIN_LATENESS_LIMIT_S = 0.005
BURST_PERIODS = 1.5
MAX_UNWATCHED_SHARE = 0.01

REMEDY = "Run again on a quieter or faster machine, or offer a lower rate."
TIMELINE_REMEDY = "Run again on a quieter or faster machine, or play the recording more slowly."


def schedule_problem(offered_hz: float, iterations: Sequence[SegmentSamples]) -> str:
    """Return why the iterations at a rate are invalid, in one sentence; empty if they are valid.

    Args:
        offered_hz: the offered rate; 0 for that of the recording.
        iterations: all complete iterations at it, at least one.
    """
    if iterations[0].live:
        return ""
    played = pool_playback([iteration.playback for iteration in iterations])
    # n steps that come irregularly take another time than n periods.
    irregular = bool(iterations[0].segment.arrivals)
    planned_hz = offered_hz if offered_hz and not irregular else played.planned_hz
    # A single publication has no rate.
    if played.sent > len(iterations) and played.rate_hz < MIN_RATE_SHARE * planned_hz:
        return (
            f"The playback reached only {show(played.rate_hz, 'Hz')} of the "
            f"{'offered' if offered_hz else 'recorded'} {show(planned_hz, 'Hz')}."
        )
    late_s = percentile(played.lateness, LATE_QUANTILE)
    allowed_s = lateness_limit_s(planned_hz)
    if late_s is not None and late_s > allowed_s:
        return (
            f"More than 1 % of the publications began over {show(allowed_s, 's')} after they "
            f"were due (p99 {show(late_s, 's')})."
        )
    stalled_s = sum(iteration.segment.monitor_held_ns for iteration in iterations) / 1e9
    played_s = sum(iteration.segment.length_s for iteration in iterations)
    if stalled_s > MAX_UNWATCHED_SHARE * played_s:
        return (
            f"The monitor had no processor for {show(stalled_s, 's')}, so the arrival times "
            "of messages are unknown."
        )
    return ""


def lateness_limit_s(planned_hz: float) -> float:
    """Return how late 99 % of the publications may begin at most.

    `planned_hz` is 0 if unknown.
    """
    if not planned_hz:
        return MIN_LATENESS_LIMIT_S
    of_busy_machine = min(MIN_LATENESS_LIMIT_S, BURST_PERIODS / planned_hz)
    return max(MAX_LATE_PERIODS / planned_hz, of_busy_machine)


def _problem(offered_hz: float, iterations: Sequence[SegmentSamples]) -> Problem | None:
    """Return what is impossible in the iterations at a rate, or wrong with their schedule."""
    if (impossible := impossible_result(iterations)) is not None:
        return impossible
    reason = schedule_problem(offered_hz, iterations)
    return Problem(reason, REMEDY if offered_hz else TIMELINE_REMEDY) if reason else None


@dataclass(frozen=True)
class PlaybackValidity:
    """The offered rates at which the playback missed its schedule or a result is impossible.

    A sequential probe ends when its player cannot go on; a probe that was sustained proves its
    rate.

    Attributes:
        iterations: what is wrong, by rate.
        probes: the same of sequential probes.
    """

    iterations: Mapping[float, Problem]
    probes: Mapping[float, Problem]

    @classmethod
    def of(cls, samples: RunSamples) -> PlaybackValidity:
        """Check complete iterations and probes; for sustained probes, not the playback."""
        played = {
            rate: _problem(rate, iterations)
            for rate, iterations in samples.iterations.items()
            if iterations
        }
        probed = {
            probe.rate_hz: impossible_result([found])
            if probe.holds
            else _problem(probe.rate_hz, [found])
            for probe in samples.record.sustained
            if (found := samples.sustained.get(probe.rate_hz)) is not None
        }
        return cls(
            {rate: problem for rate, problem in played.items() if problem is not None},
            {rate: problem for rate, problem in probed.items() if problem is not None},
        )

    def problem(self, statistic: Statistic, at_hz: float | None) -> Problem | None:
        """Return why the values of a metric at a rate are invalid; None if they are valid."""
        if statistic == "search" or at_hz is None:
            return None
        problems = self.probes if statistic == "sequential" else self.iterations
        return next((one for rate, one in problems.items() if math.isclose(rate, at_hz)), None)
