"""Whether the iterations at a rate are alike in time: a warm-up that was too short, or a climb.

Tests over iterations assume a sample of a single state of the graph. If the first iterations differ
from the others, or values climb within each start, the verdict depends on how much was played.
Iterations are compared by the logarithms of their means; for latencies these are means of the
fastest nine tenths, so that single stalls neither hide a shift of all messages nor look like it.

    first iterations  the first iteration of each start differs from the later iterations of its
                      start: by t over the starts, or in each start by a quarter or more in the same
                      direction. Of a single start, it is none of the values that the m others
                      predict: by t, and their deviation times sqrt(1 + 1 / m)
    climb             a line through the iterations of each start but the first has a slope, the
                      same in all starts: by least squares with a level for each start, and t of
                      N - S - 1 degrees of freedom

Such a part is noted, and a verdict is open if it rests on it: if it would be another without the
part, and the rest is further from what the verdict says. Fewer messages alone open nothing.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final, Literal

import numpy as np
from numpy.typing import NDArray

from r2bspec.judge.measure.metric import MetricInfo, Scope
from r2bspec.judge.measure.metric_values import message_values, metric_value
from r2bspec.judge.measure.samples import RunSamples, SegmentSamples
from r2bspec.judge.measure.times import seconds
from r2bspec.judge.measure.units import show
from r2bspec.judge.statistics.t_interval import t_quantile

_FASTEST: Final = 0.9
_ERROR: Final = 0.01
"""Two-sided, of either test: together they find a part in at most 2 % of steady runs."""

_LEAST: Final = math.log(1.05)
"""Smaller differences do not count."""

_LEAST_SINGLE: Final = math.log(1.25)
"""What a single value shows may be chance: one start in five may be slower by a fifth."""

_SMALLEST_DEVIATION: Final = 1e-3
"""Of values that agree exactly."""

_MIN_FREEDOM: Final = 3
_MIN_ITERATIONS: Final = 3
"""In each start, to tell a warm-up from a climb."""

Kind = Literal["first iterations", "climb"]
_WARM_UP: Final = "With 'warm_up: {warm_up}' it is not counted."
_EITHER: Final = (
    "Three iterations in each start would show whether it is a warm-up, which 'warm_up: {warm_up}' "
    "leaves out, or goes on."
)
_CLIMB: Final = (
    "Play longer, to see where that ends, or look for what changes: memory, queues, temperature."
)


@dataclass(frozen=True)
class UnsteadyPart:
    """A part of the iterations at a rate that differs from the rest.

    Attributes:
        kind: see above.
        value: the mean in it; of a climb, at the end of a start.
        rest: the mean in the rest; of a climb, at the beginning.
        left_out: the places of the iterations that are in it; of a climb, the earlier half of each
            start.
    """

    kind: Kind
    value: float
    rest: float
    left_out: frozenset[int]

    def text(self, info: MetricInfo) -> str:
        """Return the finding about the times of a metric, as a sentence."""
        unit = "s" if info.scope is Scope.MONITOR else info.unit
        figures = f"{show(self.value, unit)} against {show(self.rest, unit)}"
        if info.metric.level and info.metric.lost_is_slowest:
            figures += " without the slowest tenth"
        where, than = "In the first iteration of each start", "of the later ones"
        if self.kind == "climb":
            where, than = "At the end of each start", "at its beginning"
        return (
            f"{where}, {info.metric.level or info.name} was "
            f"{show(self.value / self.rest, '')} times that {than} ({figures})."
        )

    def advice(self, samples: RunSamples, iterations: Sequence[SegmentSamples]) -> str:
        """Return how to leave the part out, or to see where it ends, as a sentence."""
        if self.kind == "climb":
            return _CLIMB
        played_s = [
            segment.length_s for segment in samples.record.segments if segment.kind == "warm_up"
        ]
        needed_s = max(played_s, default=0.0) + iterations[0].segment.length_s
        # One of each start is left out.
        tells = len(iterations) >= _MIN_ITERATIONS * len(self.left_out)
        return (_WARM_UP if tells else _EITHER).format(warm_up=f"{math.ceil(needed_s)} s")

    def left_out_of(self, samples: RunSamples, at_hz: float) -> RunSamples:
        """Return the run without this part of its iterations at a rate."""
        kept = {
            rate: tuple(play for place, play in enumerate(played) if place not in self.left_out)
            if math.isclose(rate, at_hz)
            else played
            for rate, played in samples.iterations.items()
        }
        return replace(samples, iterations=kept)


@dataclass(frozen=True)
class IterationLevel:
    """The logarithm of the mean of an iteration, when it began, and its start of the processes."""

    start: int
    begun_s: float
    level: float


def iteration_levels(
    info: MetricInfo, monitor: str | None, iterations: Sequence[SegmentSamples]
) -> tuple[IterationLevel, ...]:
    """Return the levels of a metric in each iteration; empty if any of them is unknown.

    They are of latencies, or of intervals between outputs; for a mean that belongs to no monitor,
    of its value.
    """
    levels = tuple(
        IterationLevel(iteration.segment.start, iteration.segment.began_ns / 1e9, math.log(mean))
        for iteration in iterations
        if (mean := _mean_of(info, monitor, iteration)) > 0
    )
    return levels if len(levels) == len(iterations) else ()


def _mean_of(info: MetricInfo, monitor: str | None, one: SegmentSamples) -> float:
    """Return the mean that is compared; 0 if it is unknown."""
    if monitor is None:
        value = metric_value(info, monitor, one) if info.statistic == "mean" else None
        return value or 0.0
    if not info.metric.level:
        return 0.0
    seen = one.monitors[monitor]
    if info.metric.lost_is_slowest:
        values = np.sort(message_values(info, monitor, one))
        values = values[: math.ceil(_FASTEST * values.size)]
    else:
        values = np.diff(seconds(np.sort(seen.outputs["received_ns"][seen.came])))
    return float(values.mean()) if values.size else 0.0


def find_unsteady_part(played: Sequence[IterationLevel]) -> UnsteadyPart | None:
    """Return the part of the iterations at a rate that differs; None if all are alike.

    Args:
        played: the iterations, in the order of time.
    """
    numbers = np.array([play.start for play in played])
    levels = np.array([play.level for play in played])
    times_s = np.array([play.begun_s for play in played])
    starts = [np.flatnonzero(numbers == number) for number in dict.fromkeys(numbers.tolist())]
    if min(map(len, starts), default=0) < 2:
        return None
    return _climb(starts, times_s, levels) or _first_iterations(starts, levels)


def _first_iterations(
    starts: Sequence[NDArray[np.int64]], levels: NDArray[np.float64]
) -> UnsteadyPart | None:
    differences = np.array([levels[at[0]] - levels[at[1:]].mean() for at in starts])
    if len(starts) == 1:
        others = levels[1:]
        scatter = _deviation(others) * math.sqrt(1 + 1 / others.size) if others.size > 1 else 0.0
        freedom, least, agree = others.size - 1, _LEAST_SINGLE, False
    else:
        scatter = _deviation(differences) / math.sqrt(len(starts))
        freedom, least = len(starts) - 1, _LEAST
        agree = bool(differences.min() > _LEAST_SINGLE or differences.max() < -_LEAST_SINGLE)
    size = abs(float(differences.mean()))
    significant = freedom > 0 and size > max(least, t_quantile(freedom, 1 - _ERROR / 2) * scatter)
    if not significant and not agree:
        return None
    firsts = [int(at[0]) for at in starts]
    value, rest = levels[firsts].mean(), np.delete(levels, firsts).mean()
    return UnsteadyPart("first iterations", math.exp(value), math.exp(rest), frozenset(firsts))


def _climb(
    starts: Sequence[NDArray[np.int64]], times_s: NDArray[np.float64], levels: NDArray[np.float64]
) -> UnsteadyPart | None:
    kept = [at[1:] for at in starts]
    freedom = sum(map(len, kept)) - len(kept) - 1
    if min(map(len, starts)) < _MIN_ITERATIONS or freedom < _MIN_FREEDOM:
        return None
    t = np.concatenate([times_s[at] - times_s[at].mean() for at in kept])
    v = np.concatenate([levels[at] - levels[at].mean() for at in kept])
    spread = float(t @ t)
    if not spread:
        return None
    slope = float(t @ v) / spread
    residuals = v - slope * t
    deviation = max(math.sqrt(float(residuals @ residuals) / freedom), _SMALLEST_DEVIATION)
    reach = t_quantile(freedom, 1 - _ERROR / 2) * deviation / math.sqrt(spread)
    change = slope * float(np.mean([np.ptp(times_s[at]) for at in kept]))
    if abs(slope) <= reach or abs(change) <= _LEAST:
        return None
    middle = float(np.mean([levels[at].mean() for at in kept]))
    earlier = np.concatenate([at[: len(at) // 2] for at in starts])
    return UnsteadyPart(
        "climb",
        math.exp(middle + change / 2),
        math.exp(middle - change / 2),
        frozenset(earlier.tolist()),
    )


def _deviation(values: NDArray[np.float64]) -> float:
    return max(float(values.std(ddof=1)), _SMALLEST_DEVIATION)
