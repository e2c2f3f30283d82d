"""Whether the iterations at a rate are alike in time: a warm-up that was too short, or a drift.

Tests over iterations take them for a sample of one state of the graph. Where a part that is known
by its place in time differs from the rest, the verdict depends on how much of it was played. The
peak search examines its overloaded plays for that (`r2bspec.judge.stationarity`); here iterations
at a fixed rate are compared, by the logarithms of means. Of latencies these are means of the
fastest nine tenths: single stalls neither hide what all messages do, nor look like it.

    opening           the first 0.5 s or 2 s of each iteration differ from each later window of
                      that length, of which there are at least three: a recording that is repeated
                      makes windows differ, too, but not the first from all others
    half              the first half of each iteration differs from its second
    first iterations  the first iteration of each start differs from the later ones of its start
    first iteration   the same for the first start alone, by more than in the others
    first start       it differs from the later ones; of a single start, its first iteration
    drift             a line through the means of starts, or through the iterations of a single
                      start, has a slope

The first two are t tests over iterations, the third is one over starts. In the next two a value is
predicted from m others, with t, m - 1 degrees of freedom, and their deviation times
sqrt(1 + 1 / m). The slope of several starts has two independent p values: by t over the means of
the starts, and by t over the slopes within them. Fisher's method joins these (Statistical Methods
for Research Workers, 1925). Few starts leave t few degrees of freedom; where all first iterations
differ by a quarter or more, in one direction, they count without a test.

Such a part is noted, and a verdict is open if it rests on it: if it would be another without the
part, and the rest is further from what the verdict says. Fewer messages alone open nothing.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import takewhile
from typing import Final, Literal

import numpy as np
from numpy.typing import NDArray

from r2bspec.judge.measure.metric_catalogue import MetricInfo
from r2bspec.judge.measure.metric_values import later_part, metric_value
from r2bspec.judge.measure.samples import LOSS_SENSITIVE_FAMILIES, RunSamples, SegmentSamples
from r2bspec.judge.measure.times import seconds
from r2bspec.judge.measure.units import show
from r2bspec.judge.statistics.autocorrelation import Line, least_squares, serial_inflation
from r2bspec.judge.statistics.effective_sample_size import pad_rows
from r2bspec.judge.statistics.t_interval import t_quantile

_FASTEST: Final = 0.9
_OPENINGS_S: Final = (0.5, 2.0)
_MIN_WINDOWS: Final = 4
_MIN_LINE: Final = 4
"""Starts, or iterations, of a line: fewer leave t a single degree of freedom."""

_OPENING_ERROR: Final = 0.003
_HALF_ERROR: Final = 0.005
_FIRST_ERROR: Final = 0.01
_DRIFT_ERROR: Final = 0.02
"""Two-sided. Together they find a part in at most 5 % of steady runs."""

_LEAST: Final = math.log(1.05)
"""Smaller differences do not count."""

_LEAST_WITHIN: Final = math.log(1.1)
"""Within an iteration, messages of a recording differ, too."""

_LEAST_SINGLE: Final = math.log(1.25)
"""What a single value shows may be chance: one start in five may be slower by a fifth."""

_SMALLEST_DEVIATION: Final = 1e-3
"""Of values that agree exactly."""

Kind = Literal["opening", "half", "first iterations", "first iteration", "first start", "drift"]
_WHERE: Final[dict[Kind, tuple[str, str]]] = {
    "opening": ("In the first {opening} of each iteration", "of the rest"),
    "half": ("In the first half of each iteration", "of the second"),
    "first iterations": ("In the first iteration of each start", "of the later ones"),
    "first iteration": ("In the first iteration", "of the later ones"),
    "first start": ("In the first start", "of the later ones"),
    "drift": ("At the end of the run", "at its beginning"),
}
_WARM_UP: Final = "With 'warm_up: {warm_up}' it is not counted."
_ONCE_BEFORE: Final = "Play the spec once before the run that counts."
_ADVICE: Final[dict[Kind, str]] = {
    "opening": "Make iterations longer ('duration'), so that their beginning weighs less.",
    "half": "Make iterations longer ('duration'), to see where that ends.",
    "first iterations": _WARM_UP,
    "first iteration": _ONCE_BEFORE,
    "first start": _ONCE_BEFORE,
    "drift": "Play longer, to see where that ends, or look for what changes: memory, temperature.",
}
_NOUNS: Final = {
    "latency": "the latency",
    "latency_from_due": "the latency from the due time",
    "age": "the age",
    **dict.fromkeys(("throughput", "interval", "jitter"), "the interval between outputs"),
}


@dataclass(frozen=True)
class UnsteadyPart:
    """A part of the iterations at a rate that differs from the rest.

    Attributes:
        kind: see above.
        value: the mean in it; of a drift, at its end.
        rest: the mean in the rest; of a drift, at its beginning.
        left_out: the places of the iterations that are in it.
        opening_s: how much of the beginning of each iteration is.
    """

    kind: Kind
    value: float
    rest: float
    left_out: frozenset[int] = frozenset()
    opening_s: float = 0.0

    @property
    def size(self) -> float:
        """By how much it differs: the absolute logarithm of the ratio."""
        return abs(math.log(self.value / self.rest))

    def text(self, info: MetricInfo) -> str:
        """What was found by the times of a metric, as a sentence."""
        where, than = _WHERE[self.kind]
        unit = "s" if info.scope == "monitor" else info.unit
        figures = f"{show(self.value, unit)} against {show(self.rest, unit)}"
        if info.family in LOSS_SENSITIVE_FAMILIES:
            figures += " without the slowest tenth"
        return (
            f"{where.format(opening=show(self.opening_s, 's'))}, "
            f"{_NOUNS.get(info.family, info.name)} was {show(self.value / self.rest, '')} times "
            f"that {than} ({figures})."
        )

    def advice(self, samples: RunSamples, iterations: Sequence[SegmentSamples]) -> str:
        """What would leave it out, or show where it ends, as a sentence."""
        advice = _ADVICE[self.kind]
        if (
            self.kind == "first iteration"
            and len({iteration.segment.start for iteration in iterations}) == 1
        ):
            advice = _WARM_UP
        played_s = [
            segment.length_s for segment in samples.record.segments if segment.kind == "warm_up"
        ]
        needed_s = max(played_s, default=0.0) + iterations[0].segment.length_s
        return advice.format(warm_up=f"{math.ceil(needed_s)} s")

    def left_out_of(self, samples: RunSamples, at_hz: float) -> RunSamples:
        """The run without this part of its iterations at a rate."""
        kept = {
            rate: tuple(
                later_part(play, self.opening_s) if self.opening_s else play
                for place, play in enumerate(played)
                if place not in self.left_out
            )
            if math.isclose(rate, at_hz)
            else played
            for rate, played in samples.iterations.items()
        }
        return replace(samples, iterations=kept)


@dataclass(frozen=True)
class IterationTimes:
    """The times by which an iteration is compared with others.

    Attributes:
        start: of the processes.
        begun_s: when it began.
        length_s: how long it lasted; 0 if it is compared only as a whole.
        at_s: when each value came about, from `begun_s` on; shape (n,).
        values: shape (n,).
        counted: the share of the values, the smallest, of which the mean is compared.
    """

    start: int
    begun_s: float
    length_s: float
    at_s: NDArray[np.float64]
    values: NDArray[np.float64]
    counted: float = _FASTEST


def _levels(
    played: Sequence[IterationTimes], from_s: float = 0.0, until_s: float = math.inf
) -> NDArray[np.float64]:
    """The logarithm of that mean of each iteration between two times; NaN without a positive one.

    A run has thousands of iterations: all are sorted at once.
    """
    within = [play.values[(play.at_s >= from_s) & (play.at_s < until_s)] for play in played]
    sizes = np.array([values.size for values in within])
    counted = np.ceil(np.array([play.counted for play in played]) * sizes)
    ordered = np.sort(pad_rows(within, fill=math.inf), axis=1)
    ordered[np.arange(ordered.shape[1]) >= counted[:, np.newaxis]] = 0.0
    means = ordered.sum(axis=1) / np.maximum(counted, 1)
    levels: NDArray[np.float64] = np.log(means, out=np.full(means.size, math.nan), where=means > 0)
    return levels


def iteration_times(
    info: MetricInfo, monitor: str | None, iterations: Sequence[SegmentSamples]
) -> tuple[IterationTimes, ...]:
    """The times behind a metric in each iteration; nothing if those of one are unknown.

    They are latencies, or intervals between outputs; for a mean that belongs to no monitor, its
    value. An iteration that was not played at a rate is not divided: its messages differ.
    """
    known = tuple(
        times
        for iteration in iterations
        if (times := _times_of(info, monitor, iteration)) is not None
    )
    if len(known) < len(iterations) or not np.isfinite(_levels(known)).all():
        return ()
    return known


def _times_of(info: MetricInfo, monitor: str | None, one: SegmentSamples) -> IterationTimes | None:
    counted, length_s = 1.0, one.segment.length_s if one.segment.rate_hz else 0.0
    if monitor is None:
        value = metric_value(info, monitor, one) if info.statistic == "mean" else None
        at_s, values, length_s = np.zeros(1), np.array([value or math.nan]), 0.0
    else:
        seen = one.monitors[monitor]
        arrived_ns = seen.steps.received_ns[seen.steps.answered]
        if info.family in LOSS_SENSITIVE_FAMILIES:
            at_s = seconds(seen.steps.due_ns[seen.steps.answered] - one.segment.began_ns)
            values, counted = seen.times[info.family], _FASTEST
        else:
            arrived_s = seconds(np.sort(arrived_ns) - one.segment.began_ns)
            at_s, values = arrived_s[1:], np.diff(arrived_s)
    if monitor is not None and info.family not in _NOUNS:
        return None
    begun_s = one.segment.began_ns / 1e9
    times = IterationTimes(one.segment.start, begun_s, length_s, at_s, values, counted)
    # Unknown latencies have no values.
    return times if at_s.size == values.size else None


def find_unsteady_part(played: Sequence[IterationTimes]) -> UnsteadyPart | None:
    """The part of the iterations at a rate that differs most from the rest; None if all are alike.

    Args:
        played: the iterations, in the order of time.
    """
    levels = _levels(played)
    parts = (
        *_openings(played),
        *_halves(played),
        *_firsts(played, levels),
        *_drift(played, levels),
    )
    return max(parts, key=lambda part: part.size, default=None)


def _openings(played: Sequence[IterationTimes]) -> Iterator[UnsteadyPart]:
    for length_s in _OPENINGS_S:
        shortest_s = min((play.length_s for play in played), default=0.0)
        windows = int(shortest_s / length_s + 1e-6)
        if windows < _MIN_WINDOWS:
            continue
        first, rest = _levels(played, 0.0, length_s), _levels(played, length_s)
        if not _differs(first - rest, _OPENING_ERROR, _LEAST_WITHIN):
            continue
        differences = (
            first - _levels(played, at * length_s, (at + 1) * length_s) for at in range(1, windows)
        )
        # One window that does not differ is enough: most runs need no other.
        differing = list(takewhile(partial(_differs, error=_OPENING_ERROR), differences))
        if len(differing) == windows - 1 and _agree(np.mean(differing, axis=1), _LEAST_WITHIN):
            yield _part("opening", first, rest, opening_s=length_s)


def _halves(played: Sequence[IterationTimes]) -> Iterator[UnsteadyPart]:
    half_s = min((play.length_s for play in played), default=0.0) / 2
    if not half_s:
        return
    first, second = _levels(played, 0.0, half_s), _levels(played, half_s)
    if _differs(first - second, _HALF_ERROR, _LEAST_WITHIN):
        yield _part("half", first, second, opening_s=half_s)


def _firsts(
    played: Sequence[IterationTimes], levels: NDArray[np.float64]
) -> Iterator[UnsteadyPart]:
    starts = _places_by_start(played)
    if len(starts) == 1:
        if _first_differs(levels):
            yield _part("first iteration", levels[:1], levels[1:], left_out=[0])
        return
    if _first_differs(np.array([levels[places].mean() for places in starts])):
        first, rest = starts[0], np.concatenate(starts[1:])
        yield _part("first start", levels[first], levels[rest], left_out=first)
    if min(map(len, starts), default=0) < 2:
        return
    differences = np.array([levels[at[0]] - levels[at[1:]].mean() for at in starts])
    if _differs(differences, _FIRST_ERROR, _LEAST) or _agree(differences, _LEAST_SINGLE):
        firsts = [places[0] for places in starts]
        yield _part("first iterations", levels[firsts], np.delete(levels, firsts), left_out=firsts)
    if _first_differs(differences):
        yield _part("first iteration", levels[:1], levels[1:], left_out=[0])


def _drift(played: Sequence[IterationTimes], levels: NDArray[np.float64]) -> Iterator[UnsteadyPart]:
    from scipy.special import chdtrc, stdtr

    times = np.array([play.begun_s for play in played])
    starts = _places_by_start(played)
    pieces = starts if len(starts) > 1 else [np.array([place]) for place in range(len(played))]
    if len(pieces) < _MIN_LINE:
        return
    at_s = np.array([times[places].mean() for places in pieces])
    means = np.array([levels[places].mean() for places in pieces])
    line = least_squares(at_s, means)
    slope, error = line.slope, _slope_error(line)
    if len(starts) == 1:
        # Iterations of one start may resemble each other, which looks like a slope.
        error *= math.sqrt(serial_inflation(line.residuals.tolist()))
    p = float(stdtr(len(pieces) - 2, -abs(slope) / error))
    within = [least_squares(times[at], levels[at]).slope for at in pieces if len(at) > 1]
    if len(within) == len(pieces):
        t = math.copysign(1.0, slope) * np.mean(within) / _standard_error(np.array(within))
        p = float(chdtrc(4, -2 * math.log(max(p * stdtr(len(pieces) - 1, -t), 1e-300))))
    change = slope * (at_s[-1] - at_s[0])
    if p < _DRIFT_ERROR / 2 and abs(change) > _LEAST:
        ends = means.mean() + slope * (at_s[[-1, 0]] - at_s.mean())
        earlier = np.concatenate(pieces[: len(pieces) // 2])
        yield _part("drift", ends[:1], ends[1:], left_out=earlier)


def _slope_error(line: Line) -> float:
    """The standard error of a slope through three points or more."""
    squares, freedom = float(line.residuals @ line.residuals), line.residuals.size - 2
    deviation = max(math.sqrt(squares / freedom), _SMALLEST_DEVIATION)
    return deviation / math.sqrt(line.spread) if line.spread else math.inf


def _places_by_start(played: Sequence[IterationTimes]) -> list[NDArray[np.int64]]:
    numbers = np.array([play.start for play in played])
    return [np.flatnonzero(numbers == number) for number in dict.fromkeys(numbers.tolist())]


def _part(
    kind: Kind,
    part: Sequence[float] | NDArray[np.float64],
    rest: Sequence[float] | NDArray[np.float64],
    *,
    left_out: Sequence[int] | NDArray[np.int64] = (),
    opening_s: float = 0.0,
) -> UnsteadyPart:
    """A part, from logarithms."""
    places = frozenset(int(place) for place in left_out)
    value, other = (float(np.exp(np.mean(logs))) for logs in (part, rest))
    return UnsteadyPart(kind, value, other, places, opening_s)


def _differs(values: NDArray[np.float64], error: float, least: float = 0.0) -> bool:
    """Whether the mean is not 0, by t, and at least so large."""
    if values.size < 2 or not abs(values.mean()) > least:
        return False
    return bool(
        abs(values.mean()) > t_quantile(values.size - 1, 1 - error / 2) * _standard_error(values)
    )


def _standard_error(values: NDArray[np.float64]) -> float:
    return max(float(values.std(ddof=1)), _SMALLEST_DEVIATION) / math.sqrt(values.size)


def _agree(values: NDArray[np.float64], least: float) -> bool:
    """Whether all are at least so large, in one direction."""
    return bool(values.size > 1 and (values.min() > least or values.max() < -least))


def _first_differs(values: NDArray[np.float64]) -> bool:
    """Whether the first value is none of those that the others predict."""
    others = values[1:]
    if others.size < 2:
        return False
    reach = t_quantile(others.size - 1, 1 - _FIRST_ERROR / 2) * math.hypot(
        max(float(others.std(ddof=1)), _SMALLEST_DEVIATION), _standard_error(others)
    )
    return bool(abs(values[0] - others.mean()) > max(reach, _LEAST_SINGLE))
