"""What an overloaded graph shows: its capacity, and whether its speed is stationary.

Capacity
--------

A graph that is offered more than it can process is never idle, so its outputs leave at its own
pace. They are cut into batches of k successive ones; a batch lasts x_j seconds a message. With the
mean x and the standard deviation s of m batches of all plays,

    capacity = 1 / x        bounds: 1 / (x +- t s sqrt(F / m))

with Student's t of m / F - 1 degrees of freedom and the inflation F of batches that resemble their
neighbours (`r2bspec.judge.statistics.trend`), where that is significant: batches of a
second or longer of a stationary graph are independent, and a graph that is not is found by the
tests below. The start of each play is left out.

Queues in a row approach the capacity from below: n messages take longer than n / capacity by
g cv sqrt(n) / capacity, where cv is the coefficient of variation of a service time, and g is the
mean of the largest eigenvalue of a random matrix, at most 2 sqrt(k) - 1.77 k^(-1/6) for k queues
(Glynn and Whitt 1991; Baryshnikov 2001). The upper bound is raised by that.

Stationarity
------------

A bracket of the peak says something of tomorrow only if the graph processes messages today as it
did a minute ago. What is examined are its outputs while it is overloaded, when they leave at its
own pace, and while the lower end of the bracket is played whole. Each finding has figures, and a
share by which the speed varies.

    stops     gaps between outputs that are longer than the 90th percentile of the gaps by twelve
              times the distance from the median to it, and half the precision of the time in all,
              or that may be the precision of it in the long run. A single one counts if it is too
              long for a message
    start     the first 1, 2 or 5 s of a play are faster or slower than the rest of it
    drift     a line through the batches of all plays, by time, has a slope
    wander    the batches differ by more than the scatter of single messages explains: for batches
              of k independent messages the variance is that of a message divided by k

The last three count only beyond the precision, and with an error of about one in ten thousand, so
that a steady graph is rarely called unsteady.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from r2bspec.judge.statistics.t_interval import t_quantile
from r2bspec.judge.statistics.trend import least_squares, significant_inflation

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

_KEPT_UP_SHARE = 0.998
"""One that delivers more than this in the later half of a play has caught up."""


@dataclass(frozen=True)
class CompletionTimes:
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
        """Return the times without those of the start."""
        start_s = min(max(_START_SHARE * self.played_s, _START_S), _MAX_START_SHARE * self.played_s)
        return self.times_s[self.times_s >= start_s]

    def after(self, seconds: float) -> CompletionTimes:
        """Return the later part of this play, as a play."""
        later = self.times_s[self.times_s >= seconds] - seconds
        return CompletionTimes(
            self.begun_s + seconds,
            later,
            max(self.played_s - seconds, 0.0),
            self.offered_hz,
            self.per_step,
        )

    @property
    def saturated_later(self) -> bool:
        """Whether clearly fewer outputs left than inputs came in the second half."""
        return self._is_slower(self.times_s[self.times_s >= self.played_s / 2], _KEPT_UP_SHARE)

    @property
    def saturated(self) -> bool:
        """Whether clearly fewer outputs left than inputs came, after the start."""
        return self._is_slower(self.settled(), _SATURATED_SHARE)

    def _is_slower(self, times_s: NDArray[np.float64], share: float) -> bool:
        """Return whether outputs at these times are fewer than a share of what is offered."""
        if times_s.size < _MIN_BATCH_OUTPUTS:
            return True
        rate_hz = (times_s.size - 1) / max(float(times_s[-1] - times_s[0]), 1e-9)
        return rate_hz < share * self.offered_hz


@dataclass(frozen=True)
class Capacity:
    """The capacity in steps per second, with bounds that are wrong in half the error each.

    Attributes:
        drowns: by how much faster the graph is there than in the plays with the least overload.
    """

    hz: float
    lower_hz: float
    upper_hz: float
    drowns: float = 0.0

    @property
    def relative_width(self) -> float:
        """The distance of the bounds as a fraction of the lower bound."""
        return self.upper_hz / self.lower_hz - 1 if self.lower_hz > 0 else math.inf

    @property
    def gentle_width(self) -> float:
        """The relative width that the plays with the least overload show."""
        return 2 * (self.hz / (1 + self.drowns) / self.lower_hz - 1)


@dataclass(frozen=True)
class Batches:
    """The seconds per message in batches of successive outputs, and when each batch began."""

    seconds: NDArray[np.float64]
    begun_s: NDArray[np.float64]
    outputs: int


def batches(play: CompletionTimes) -> Batches:
    """Cut the settled part of a play into batches of about a second."""
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
    plays: Sequence[CompletionTimes],
    confidence: float,
    *,
    stages: int = 1,
    harder: Sequence[CompletionTimes] = (),
) -> Capacity | None:
    """Estimate the capacity from overloaded plays.

    Args:
        plays: the departures of each.
        confidence: the confidence of the interval; each bound is wrong in half of the rest.
        stages: how many queues there may be in a row.
        harder: plays with more overload, which show how much slower the graph is with more.

    Returns:
        None if there are too few outputs.
    """
    gentle = _overload_pace(plays, confidence)
    if gentle is None:
        return None
    # A single play has too few batches to tell whether they resemble their neighbours.
    hard = _overload_pace(harder, confidence, independent=True)
    hz = _at_capacity(gentle, hard)
    # Faster messages at the lower rate, or slower ones at the higher rate, are a higher capacity.
    faster = replace(gentle, mean_s=gentle.mean_s - gentle.half_s)
    upper_hz = math.inf
    if faster.mean_s > 0:
        more_hz = _at_capacity(faster, hard) - hz
        if hard is not None:
            slower = replace(hard, mean_s=hard.mean_s + hard.half_s)
            more_hz = math.hypot(more_hz, _at_capacity(gentle, slower) - hz)
        upper_hz = hz + more_hz
    per_step = plays[0].per_step
    return Capacity(
        hz=hz / per_step,
        lower_hz=1 / (gentle.mean_s + gentle.half_s) / per_step,
        upper_hz=upper_hz * (1 + _approach(plays, stages)) / per_step,
        drowns=hz * gentle.mean_s - 1,
    )


@dataclass(frozen=True)
class _OverloadPace:
    """Seconds a message with a bound that is wrong in half the error, at an offered rate."""

    mean_s: float
    half_s: float
    offered_hz: float


def _overload_pace(
    plays: Sequence[CompletionTimes], confidence: float, *, independent: bool = False
) -> _OverloadPace | None:
    if not plays:
        return None
    seconds = np.concatenate([batches(play).seconds for play in plays])
    m = seconds.size
    if m < _MIN_BATCHES:
        return None
    inflation = 1.0 if independent else significant_inflation(seconds.tolist())
    error = _ERROR_SHARE * (1 - confidence) / 2
    t = t_quantile(max(m / inflation - 1, 1.0), 1 - error)
    return _OverloadPace(
        mean_s=float(seconds.mean()),
        half_s=t * float(seconds.std(ddof=1)) * math.sqrt(inflation / m),
        offered_hz=sum(play.offered_hz for play in plays) / len(plays),
    )


def _at_capacity(gentle: _OverloadPace, hard: _OverloadPace | None) -> float:
    """Return the rate at which a message takes as long as until the next one comes.

    The seconds a message, x, grow evenly with the rate that is offered, by b: the rate r is that at
    which 1 / r = x - b (offered - r).
    """
    if hard is None or hard.mean_s <= gentle.mean_s:
        return 1 / gentle.mean_s
    grows = (hard.mean_s - gentle.mean_s) / (hard.offered_hz - gentle.offered_hz)
    rest = gentle.mean_s - grows * gentle.offered_hz
    return 2 / (rest + math.sqrt(rest**2 + 4 * grows))


def _approach(plays: Sequence[CompletionTimes], stages: int) -> float:
    """Return how far queues in a row still are below their capacity, as a fraction of it."""
    if stages < 2:
        return 0.0
    largest = 2 * math.sqrt(stages) - 1.77 / math.pow(stages, 1 / 6)
    intervals = np.concatenate([np.diff(play.settled()) for play in plays])
    mean = float(intervals.mean()) if intervals.size else 0.0
    if mean <= 0:
        return 0.0
    variation = min(float(intervals.std()) / mean, 1.0)
    before, until = plays[0].times_s.size - plays[0].settled().size, plays[0].times_s.size
    longer = math.sqrt(until) - math.sqrt(max(before, 0))
    return largest * variation * longer / max(until - before, 1)


_MIN_STOP_S = 0.05
_STOP_PERIODS = 3.0
_STOP_TAILS = 12.0
_MAX_STOPPED = 0.9
_STOPS_ERROR = 0.05
"""With which more stops than that come in the long run."""

_STARTS_S = (1.0, 2.0, 5.0)
_ERROR = 1e-4
"""With which a steady graph is called unsteady by one of the tests."""

_MIN_COMPARED_BATCHES = 6
_WANDER_RATIO = 3.0


@dataclass(frozen=True)
class NonStationarity:
    """A finding: its text, and the ratio of the fastest speed to the slowest."""

    text: str
    ratio: float


def find_stops(plays: Sequence[CompletionTimes], precision: float) -> NonStationarity | None:
    """Return stops of the output in plays whose inputs did not pause.

    From n stops in the time that was played up to U(n) times their mean length are expected in as
    much time, with U(n) the upper bound of a Poisson mean (Garwood 1936); 4.7 for one.
    """
    lengths: list[float] = []
    is_message = True
    total_s = 0.0
    for play in plays:
        if play.times_s.size <= 2:
            continue
        # What stops until the end of a play has no output after it.
        ended_s = max(play.played_s, float(play.times_s[-1]))
        gap = np.diff(play.times_s, append=ended_s)
        middle, tail, far = (float(bound) for bound in np.quantile(gap, (0.5, 0.9, 0.99)))
        least_s = max(_MIN_STOP_S, _STOP_PERIODS * middle, tail + _STOP_TAILS * (tail - middle))
        stops_s = gap[gap > least_s] - middle
        if stops_s.size:
            # The longest message that so many log-normal ones may have among them.
            scatter = math.log(max(far, 1e-9) / max(middle, 1e-9)) / _normal_quantile(0.01)
            longest_s = middle * math.exp(scatter * _normal_quantile(_ERROR / gap.size))
            is_message = is_message and float(stops_s.max()) <= longest_s
        lengths += stops_s.tolist()
        total_s += ended_s - float(play.times_s[0])
    number, stopped_s = len(lengths), sum(lengths)
    if not number or (number == 1 and is_message):
        return None
    share = min(_most_stops(number) * stopped_s / number / total_s, _MAX_STOPPED)
    if share < precision and (number == 1 or stopped_s < precision / 2 * total_s):
        return None
    length, every_s = float(np.median(lengths)), total_s / number
    text = (
        f"stops for {length:.2g} s about every {every_s:.2g} s"
        if number > 1
        else f"stopped for {length:.2g} s, once in {total_s:.0f} s"
    )
    return NonStationarity(text, 1 / (1 - share))


def _most_stops(number: int) -> float:
    from scipy.special import chdtri

    return float(chdtri(2 * number + 2, _STOPS_ERROR)) / 2


def find_start(plays: Sequence[CompletionTimes], precision: float) -> NonStationarity | None:
    """Return the clearest start that is faster or slower than the rest of an overloaded play."""
    findings: list[NonStationarity] = []
    for seconds in _STARTS_S:
        long = [play for play in plays if play.played_s >= 1.8 * seconds]
        first, rest = _pace(long, 0.0, seconds), _pace(long, seconds, math.inf)
        if first is None or rest is None:
            continue
        log_ratio = math.log(rest.mean_s / first.mean_s)
        # A few messages may agree by chance.
        scatter = rest.variation / math.sqrt(first.outputs) * _normal_quantile()
        reach = math.hypot(max(first.reach, scatter), rest.reach)
        if abs(log_ratio) <= max(reach, precision):
            continue
        ratio = math.exp(abs(log_ratio))
        word = "faster" if log_ratio > 0 else "slower"
        findings.append(
            NonStationarity(f"{ratio:.2f} times {word} in the first {seconds:g} s", ratio)
        )
    return max(findings, key=lambda each: each.ratio, default=None)


def find_drift(plays: Sequence[CompletionTimes], precision: float) -> NonStationarity | None:
    """Return the finding that the speed falls or rises over all plays."""
    cut = [batches(play) for play in plays]
    pace = np.concatenate([np.empty(0), *(part.seconds for part in cut)])
    at_s = np.concatenate([np.empty(0), *(part.begun_s for part in cut)])
    if pace.size < _MIN_COMPARED_BATCHES or pace.min() <= 0:
        return None
    line = least_squares(at_s, np.log(pace))
    if not line.spread:
        return None
    error = math.sqrt(float(line.residuals @ line.residuals) / (pace.size - 2) / line.spread)
    span_s = float(np.ptp(at_s))
    change = line.slope * span_s
    reach = t_quantile(pace.size - 2, 1 - _ERROR) * error
    if abs(line.slope) <= reach or abs(change) < precision:
        return None
    ratio = math.exp(abs(change))
    word = "slower" if change > 0 else "faster"
    return NonStationarity(f"{ratio:.2f} times {word} after {span_s:.0f} s than at first", ratio)


def find_wander(plays: Sequence[CompletionTimes], precision: float) -> NonStationarity | None:
    """Return the finding that the speed varies by the second more than single messages explain."""
    cut = [batches(play) for play in plays]
    pace = np.concatenate([np.empty(0), *(part.seconds for part in cut)])
    if pace.size < _MIN_COMPARED_BATCHES or pace.min() <= 0:
        return None
    expected = float(
        np.mean(
            [
                np.var(np.diff(play.settled())) / play_times.outputs
                for play, play_times in zip(plays, cut, strict=True)
                if play_times.outputs
            ]
        )
    )
    variance = float(np.var(pace, ddof=1))
    deviation = math.sqrt(variance) / float(pace.mean())
    if deviation < precision or variance <= _wander_limit(pace.size) * expected:
        return None
    low, high = (float(bound) for bound in np.quantile(1 / pace, (0.05, 0.95)))
    per_step = plays[0].per_step
    return NonStationarity(
        f"its speed wanders between {low / per_step:.3g} Hz and {high / per_step:.3g} Hz",
        high / low,
    )


def _wander_limit(size: int) -> float:
    """Return the ratio of variances that independent messages exceed once in ten thousand plays."""
    from scipy.special import chdtri

    return max(_WANDER_RATIO, float(chdtri(size - 1, _ERROR)) / (size - 1))


def _normal_quantile(error: float = _ERROR) -> float:
    from scipy.special import ndtri

    return float(ndtri(1 - error))


@dataclass(frozen=True)
class _Pace:
    mean_s: float
    relative_error: float
    number: int
    variation: float
    outputs: int

    @property
    def reach(self) -> float:
        """Up to where the mean may be off, relatively, with a small error."""
        return t_quantile(self.number - 1, 1 - _ERROR) * self.relative_error


def _pace(plays: Sequence[CompletionTimes], from_s: float, until_s: float) -> _Pace | None:
    """Seconds a message in one part of all plays, and its standard error by short batches."""
    parts: list[NDArray[np.float64]] = []
    intervals: list[NDArray[np.float64]] = []
    for play in plays:
        # The first outputs fill the queues of the graph.
        kept = play.times_s[(play.times_s >= from_s) & (play.times_s < until_s)]
        if kept.size >= 8:
            number = min(8, (kept.size - 1) // 4) or 1
            places = np.linspace(0, kept.size - 1, number + 1).astype(int)
            parts.append(np.diff(kept[places]) / np.diff(places))
            intervals.append(np.diff(kept))
    if not parts:
        return None
    values = np.concatenate(parts)
    if values.size < 2 or values.mean() <= 0:
        return None
    error = float(values.std(ddof=1)) / math.sqrt(values.size) / float(values.mean())
    single = np.concatenate(intervals)
    variation = float(single.std() / single.mean())
    return _Pace(float(values.mean()), error, values.size, variation, single.size)


def find_nonstationarity(
    overloaded: Sequence[CompletionTimes], others: Sequence[CompletionTimes], precision: float
) -> tuple[NonStationarity, ...]:
    """Return all findings about a graph.

    Args:
        overloaded: plays in which outputs left at the pace of the graph.
        others: plays at rates that it might keep up with; they can only show stops.
        precision: differences below it do not count.
    """
    stops = find_stops([*overloaded, *others], precision)
    if stops is not None:
        return (stops,)
    for find in (find_start, find_drift, find_wander):
        finding = find(overloaded, precision)
        if finding is not None:
            return (finding,)
    return ()
