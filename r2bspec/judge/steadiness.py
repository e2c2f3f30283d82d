"""Whether a graph is steady: stops, a faster or slower start, a speed that drifts or wanders.

A bracket of the peak says something of tomorrow only if the graph processes messages today as it
did a minute ago. What is examined are its outputs while it is overloaded, when they leave at its
own pace, and while the lower end of the bracket is played whole. Each finding has figures, and a
share by which the speed varies.

    stops     gaps between outputs that are longer than the 90th percentile of the gaps by twelve
              times the distance from the median to it, twice or more, and half the precision of
              the time in all
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
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from r2bspec.judge.capacity_estimate import Departures, batches

_MIN_STOP_S = 0.05
_STOP_PERIODS = 3.0
_STOP_TAILS = 12.0
_MIN_STOPS = 2

_STARTS_S = (1.0, 2.0, 5.0)
_ERROR = 1e-4
"""With which a steady graph is called unsteady by one of the tests."""

_MIN_BATCHES = 6
_WANDER_RATIO = 3.0


@dataclass(frozen=True)
class Unsteady:
    """One finding: its text, and the ratio of the fastest speed to the slowest."""

    text: str
    ratio: float


def find_stops(plays: Sequence[Departures], precision: float) -> Unsteady | None:
    """Stops of the output in plays whose inputs did not pause."""
    gaps = [np.diff(each.times_s) for each in plays if each.times_s.size > 2]
    if not gaps:
        return None
    lengths: list[float] = []
    total_s = 0.0
    for play, gap in zip((each for each in plays if each.times_s.size > 2), gaps, strict=True):
        middle, tail = (float(each) for each in np.quantile(gap, (0.5, 0.9)))
        least_s = max(_MIN_STOP_S, _STOP_PERIODS * middle, tail + _STOP_TAILS * (tail - middle))
        at = np.flatnonzero(gap > least_s)
        lengths += (gap[at] - middle).tolist()
        total_s += float(play.times_s[-1] - play.times_s[0])
    stopped_s = sum(lengths)
    if len(lengths) < _MIN_STOPS or stopped_s < precision / 2 * total_s:
        return None
    every_s = total_s / len(lengths)
    return Unsteady(
        f"stops for {np.median(lengths):.2g} s about every {every_s:.2g} s",
        total_s / max(total_s - stopped_s, 1e-9),
    )


def find_start(plays: Sequence[Departures], precision: float) -> Unsteady | None:
    """A start that is faster or slower than the rest of an overloaded play; the clearest one."""
    found: list[Unsteady] = []
    for seconds in _STARTS_S:
        long = [each for each in plays if each.played_s >= 1.8 * seconds]
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
        found.append(Unsteady(f"{ratio:.2f} times {word} in the first {seconds:g} s", ratio))
    return max(found, key=lambda each: each.ratio, default=None)


def find_drift(plays: Sequence[Departures], precision: float) -> Unsteady | None:
    """A speed that falls or rises over all plays."""
    cut = [batches(each) for each in plays]
    pace = np.concatenate([each.seconds for each in cut]) if cut else np.empty(0)
    at_s = np.concatenate([each.begun_s for each in cut]) if cut else np.empty(0)
    if pace.size < _MIN_BATCHES or pace.min() <= 0:
        return None
    from scipy.special import stdtrit

    t = at_s - at_s.mean()
    v = np.log(pace)
    spread = float(t @ t)
    if spread <= 0:
        return None
    slope = float(t @ (v - v.mean())) / spread
    residuals = v - v.mean() - slope * t
    error = math.sqrt(float(residuals @ residuals) / (pace.size - 2) / spread)
    span_s = float(at_s[-1] - at_s[0])
    change = slope * span_s
    reach = float(stdtrit(pace.size - 2, 1 - _ERROR)) * error
    if abs(slope) <= reach or abs(change) < precision:
        return None
    ratio = math.exp(abs(change))
    word = "slower" if change > 0 else "faster"
    return Unsteady(f"{ratio:.2f} times {word} after {span_s:.0f} s than at first", ratio)


def find_wander(plays: Sequence[Departures], precision: float) -> Unsteady | None:
    """A speed that differs from second to second by more than single messages explain."""
    cut = [batches(each) for each in plays]
    pace = np.concatenate([each.seconds for each in cut]) if cut else np.empty(0)
    if pace.size < _MIN_BATCHES or pace.min() <= 0:
        return None
    expected = float(
        np.mean(
            [
                np.var(np.diff(play.settled())) / each.outputs
                for play, each in zip(plays, cut, strict=True)
                if each.outputs
            ]
        )
    )
    variance = float(np.var(pace, ddof=1))
    deviation = math.sqrt(variance) / float(pace.mean())
    if deviation < precision or variance <= _wander_limit(pace.size) * expected:
        return None
    low, high = (float(each) for each in np.quantile(1 / pace, (0.05, 0.95)))
    per_step = plays[0].per_step
    return Unsteady(
        f"its speed wanders between {low / per_step:.3g} Hz and {high / per_step:.3g} Hz",
        high / low,
    )


def _wander_limit(size: int) -> float:
    """The ratio of variances that independent messages exceed once in ten thousand plays."""
    from scipy.special import chdtri

    return max(_WANDER_RATIO, float(chdtri(size - 1, _ERROR)) / (size - 1))


def _normal_quantile() -> float:
    from scipy.special import ndtri

    return float(ndtri(1 - _ERROR))


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
        from scipy.special import stdtrit

        return float(stdtrit(self.number - 1, 1 - _ERROR)) * self.relative_error


def _pace(plays: Sequence[Departures], from_s: float, until_s: float) -> _Pace | None:
    """Seconds a message in one part of all plays, and its standard error by short batches."""
    parts: list[NDArray[np.float64]] = []
    intervals: list[NDArray[np.float64]] = []
    for play in plays:
        # The first outputs fill the queues of the graph.
        kept = play.times_s[(play.times_s >= from_s) & (play.times_s < until_s)]
        if kept.size >= 8:
            number = min(8, (kept.size - 1) // 4) or 1
            edges = kept[np.linspace(0, kept.size - 1, number + 1).astype(int)]
            counts = np.diff(np.linspace(0, kept.size - 1, number + 1).astype(int))
            parts.append(np.diff(edges) / counts)
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


def find_unsteadiness(
    overloaded: Sequence[Departures], others: Sequence[Departures], precision: float
) -> tuple[Unsteady, ...]:
    """All findings about a graph.

    Args:
        overloaded: plays in which outputs left at the pace of the graph.
        others: plays at rates that it might keep up with; they can only show stops.
        precision: differences below it do not count.
    """
    stops = find_stops([*overloaded, *others], precision)
    if stops is not None:
        return (stops,)
    for find in (find_start, find_drift, find_wander):
        found = find(overloaded, precision)
        if found is not None:
            return (found,)
    return ()
