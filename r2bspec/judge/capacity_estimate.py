"""The capacity of a graph, estimated while it is overloaded.

A graph that is offered more than it can process is never idle, so its outputs leave at its own
pace. They are cut into batches of k successive ones; a batch lasts x_j seconds a message. With the
mean x and the standard deviation s of m batches of all plays,

    capacity = 1 / x        bounds: 1 / (x +- t s sqrt(F / m))

with Student's t of m / F - 1 degrees of freedom and the inflation F of batches that resemble their
neighbours (`r2bspec.judge.statistics.autocorrelation`), where that is significant: batches of a
second or longer of a steady graph are independent, and a graph that is not steady is found by
`r2bspec.judge.steadiness`. The start of each play is left out.

Queues in a row approach the capacity from below: n messages take longer than n / capacity by
g cv sqrt(n) / capacity, where cv is the coefficient of variation of a service time, and g is the
mean of the largest eigenvalue of a random matrix, at most 2 sqrt(k) - 1.77 k^(-1/6) for k queues
(Glynn and Whitt 1991; Baryshnikov 2001). The upper bound is raised by that.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from r2bspec.judge.statistics.autocorrelation import significant_inflation

_START_SHARE = 0.1
_START_S = 1.0
_MAX_START_SHARE = 1 / 3
"""At the start, a tenth of a play is left out, or 1 s if that is at most a third of it."""

_ERROR_SHARE = 0.9
"""Of the error, the part that the interval has: the rest is what it costs that playing ends when
the interval is narrow enough."""

_BATCH_S = 1.0
_MIN_BATCH_OUTPUTS = 10
_MIN_BATCHES = 4

_SATURATED_SHARE = 0.96
"""A graph that delivers more than this share of the offered rate is not overloaded."""


@dataclass(frozen=True)
class Departures:
    """When the outputs of one play left the graph, until the last input was published.

    Attributes:
        begun_s: when its first input was published, by a clock of the whole search, in s.
        times_s: when each output arrived, from `begun_s` on, ascending, shape (n,).
        played_s: from its first input to the last.
        offered_hz: outputs per second that a graph which keeps up would deliver.
        per_step: outputs for each input.
    """

    begun_s: float
    times_s: NDArray[np.float64]
    played_s: float
    offered_hz: float
    per_step: float = 1.0

    def settled(self) -> NDArray[np.float64]:
        """The times without those of the start."""
        start_s = min(max(_START_SHARE * self.played_s, _START_S), _MAX_START_SHARE * self.played_s)
        return self.times_s[self.times_s >= start_s]

    def after(self, seconds: float) -> Departures:
        """The later part of this play, as one of its own."""
        later = self.times_s[self.times_s >= seconds] - seconds
        return Departures(
            self.begun_s + seconds,
            later,
            max(self.played_s - seconds, 0.0),
            self.offered_hz,
            self.per_step,
        )

    @property
    def saturated_later(self) -> bool:
        """Whether clearly fewer outputs left than inputs came in the later half."""
        later = self.times_s[self.times_s >= self.played_s / 2]
        if later.size < _MIN_BATCH_OUTPUTS:
            return True
        rate_hz = (later.size - 1) / max(float(later[-1] - later[0]), 1e-9)
        return rate_hz < 0.998 * self.offered_hz

    @property
    def saturated(self) -> bool:
        """Whether clearly fewer outputs left than inputs came, after the start."""
        times_s = self.settled()
        if times_s.size < _MIN_BATCH_OUTPUTS:
            return True
        rate_hz = (times_s.size - 1) / max(float(times_s[-1] - times_s[0]), 1e-9)
        return rate_hz < _SATURATED_SHARE * self.offered_hz


@dataclass(frozen=True)
class Capacity:
    """The capacity in steps per second, with bounds that are wrong in half the error each."""

    hz: float
    lower_hz: float
    upper_hz: float

    @property
    def relative_width(self) -> float:
        """From the lower bound to the upper one, as a fraction of the lower one."""
        return self.upper_hz / self.lower_hz - 1 if self.lower_hz > 0 else math.inf


@dataclass(frozen=True)
class Batches:
    """Seconds a message in batches of successive outputs, and when each began."""

    seconds: NDArray[np.float64]
    begun_s: NDArray[np.float64]
    outputs: int


def batches(play: Departures) -> Batches:
    """Cut what is settled of a play into batches of about a second."""
    times_s = play.settled()
    span_s = float(times_s[-1] - times_s[0]) if times_s.size > 1 else 0.0
    if span_s <= 0:
        return Batches(np.empty(0), np.empty(0), 0)
    outputs = max(_MIN_BATCH_OUTPUTS, round((times_s.size - 1) / span_s * _BATCH_S))
    number = (times_s.size - 1) // outputs
    # What is left over is at the start.
    first = (times_s.size - 1) - number * outputs
    edges = times_s[first::outputs]
    return Batches(np.diff(edges) / outputs, play.begun_s + edges[:-1], outputs)


def estimate_capacity(
    plays: Sequence[Departures], confidence: float, *, stages: int = 1
) -> Capacity | None:
    """Estimate the capacity from overloaded plays.

    Args:
        plays: the departures of each.
        confidence: of the interval; each bound is wrong in half of the rest.
        stages: how many queues there may be in a row.

    Returns:
        None if there are too few outputs.
    """
    if not plays:
        return None
    from scipy.special import stdtrit

    cut = [batches(each) for each in plays]
    seconds = np.concatenate([each.seconds for each in cut])
    m = seconds.size
    if m < _MIN_BATCHES:
        return None
    mean_s = float(seconds.mean())
    inflation = significant_inflation(seconds.tolist())
    error = _ERROR_SHARE * (1 - confidence) / 2
    t = float(stdtrit(max(m / inflation - 1, 1.0), 1 - error))
    half_s = t * float(seconds.std(ddof=1)) * math.sqrt(inflation / m)
    per_step = plays[0].per_step
    upper_hz = 1 / (mean_s - half_s) if half_s < mean_s else math.inf
    return Capacity(
        hz=1 / mean_s / per_step,
        lower_hz=1 / (mean_s + half_s) / per_step,
        upper_hz=upper_hz * (1 + _approach(plays, stages)) / per_step,
    )


def compare_pace(one: Sequence[Departures], other: Sequence[Departures]) -> tuple[float, float]:
    """By how much longer a message takes in one group of plays, as a fraction, and its error."""
    first, second = (
        np.concatenate([batches(each).seconds for each in plays]) for plays in (one, other)
    )
    if min(first.size, second.size) < _MIN_BATCHES:
        return 0.0, math.inf
    errors = [
        float(each.std(ddof=1) / each.mean()) / math.sqrt(each.size) for each in (first, second)
    ]
    return float(first.mean() / second.mean()) - 1, math.hypot(*errors)


def _approach(plays: Sequence[Departures], stages: int) -> float:
    """By how much queues in a row are still below their capacity, as a fraction of it."""
    if stages < 2:
        return 0.0
    largest = 2 * math.sqrt(stages) - 1.77 / math.pow(stages, 1 / 6)
    intervals = np.concatenate([np.diff(each.settled()) for each in plays])
    mean = float(intervals.mean()) if intervals.size else 0.0
    if mean <= 0:
        return 0.0
    variation = min(float(intervals.std()) / mean, 1.0)
    before, until = plays[0].times_s.size - plays[0].settled().size, plays[0].times_s.size
    longer = math.sqrt(until) - math.sqrt(max(before, 0))
    return largest * variation * longer / max(until - before, 1)
