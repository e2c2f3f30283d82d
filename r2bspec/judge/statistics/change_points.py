"""Change points of a history: the results after which the values differ from those before.

E-divisive (Matteson and James, "A nonparametric approach for multiple change point analysis of
multivariate data", JASA 109, 2014) with the distance of means: of n values v, the split k with the
largest

    q(k) = n / (k (n - k)) (sum over i < k of (v_i - mean v))^2

is the candidate, and each side is searched in the same way. As in Hunter (Fleming et al., "Using
change point detection to hunt for performance regressions", ICPE 2023) the whole and windows that
overlap are searched, because a change that was taken back soon does not show in the whole, and
afterwards each candidate is tested again between its neighbours.

Significance. With the t statistic t^2 = (n - 2) q / (sum of squares - q), Student's t with
Bonferroni's factor for the number of splits decides what is far from the limit, and histories
that are too short to permute. Otherwise the values are permuted: the share of permutations whose
largest q is at least as large is exact for exchangeable values, whatever their distribution.

A single result is no change. So the values of a window that is permuted are first limited to three
robust standard deviations (of the median absolute deviation) around their median. The limits depend
on all values alike, so that permutations stay exact, however skewed the values and however large
single ones are. Where most values are equal, as with drops that are rare, there is no such
deviation: nothing is limited, and permutations alone decide.

Found shares and false alarms are simulated (`tests/simulation/test_simulation_trend.py`).
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

Values = NDArray[np.float64]

LEVEL: Final = 0.0005
"""The probability of a false change point in a window."""

_MIN_SIDE: Final = 3
MIN_RESULTS: Final = 2 * _MIN_SIDE
"""Fewer values have no change point."""

_WINDOW: Final = 50
_LIMIT: Final = 3 * 1.4826
"""In median absolute deviations."""

_PERMUTATIONS: Final = 9_999
_CHUNK: Final = 1_000
_MIN_PERMUTED: Final = 20
"""With fewer values, too few permutations differ."""

_CLEAR: Final = 1e-9
_HOPELESS: Final = 0.05
_ROUNDING: Final = 1e-12


@dataclass(frozen=True, order=True)
class _Candidate:
    """A split of values, the most probable first."""

    error: float
    error_of_t: float
    place: int


@dataclass(frozen=True)
class ChangePoint:
    """A change of the mean.

    Attributes:
        place: the index of the first value after it.
        error: the probability of such a difference by chance.
        before: the mean of the values since the change point before.
        after: the mean of the values until the next change point.
    """

    place: int
    error: float
    before: float
    after: float


def change_points(values: Values, level: float = LEVEL) -> list[ChangePoint]:
    """Return the change points of values in the order of time; a deterministic function.

    Args:
        values: shape (n,), finite.
        level: the largest `ChangePoint.error`.
    """
    search = _Search(values, level)
    ends = [0, *search.split(0, values.size), values.size]
    found = [
        candidate
        for before, after in zip(ends[:-2], ends[2:], strict=True)
        if (candidate := search.test(before, after)).error <= level
    ]
    # Both neighbours of a candidate that was not confirmed may move to its place.
    errors = {candidate.place: candidate.error for candidate in found}
    places = sorted(errors)
    means = [float(part.mean()) for part in np.split(values, places) if part.size]
    return [
        ChangePoint(place, errors[place], means[number], means[number + 1])
        for number, place in enumerate(places)
    ]


class _Search:
    """The search in one history."""

    def __init__(self, values: Values, level: float) -> None:
        self._level = level
        self._values = values
        self._random = np.random.default_rng(0)

    def split(self, start: int, end: int) -> list[int]:
        """Return the candidates between two places, in order."""
        if end - start < MIN_RESULTS:
            return []
        best = min(self.test(*window) for window in _windows(start, end))
        if best.error > self._level:
            return []
        return [*self.split(start, best.place), best.place, *self.split(best.place, end)]

    def test(self, start: int, end: int) -> _Candidate:
        """Return the best split between two places."""
        values = self._values[start:end]
        n = values.size
        middle = np.median(values)
        reach = _LIMIT * float(np.median(np.abs(values - middle)))
        if reach and n >= _MIN_PERMUTED:
            values = np.clip(values, middle - reach, middle + reach)
        gains = _gains(values)
        place = int(np.argmax(gains))
        gain = float(gains[place])
        total = float(((values - values.mean()) ** 2).sum())
        if gain <= _ROUNDING * float((values**2).sum()):
            return _Candidate(1.0, 1.0, start + place + _MIN_SIDE)
        error_of_t = _t_error(gain, total, n) * gains.size
        error = error_of_t
        is_clear = not _CLEAR < error < _HOPELESS
        if not (error >= _HOPELESS or (reach and (is_clear or n < _MIN_PERMUTED))):
            error = self._permuted_error(values, gain)
        return _Candidate(min(error, 1.0), error_of_t, start + place + _MIN_SIDE)

    def _permuted_error(self, values: Values, gain: float) -> float:
        """Return the share of permutations that split as well; ends once it is above the level."""
        done = as_good = 0
        while done < _PERMUTATIONS and as_good <= self._level * (_PERMUTATIONS + 1):
            number = min(_CHUNK, _PERMUTATIONS - done)
            permuted = self._random.permuted(np.tile(values, (number, 1)), axis=1)
            as_good += int((_gains(permuted).max(axis=1) >= gain * (1 - _ROUNDING)).sum())
            done += number
        return (1 + as_good) / (1 + done)


def _windows(start: int, end: int) -> Iterator[tuple[int, int]]:
    yield start, end
    if end - start > _WINDOW:
        last = end - _WINDOW
        for first in (*range(start, last, _WINDOW // 2), last):
            yield first, first + _WINDOW


def _gains(values: Values) -> Values:
    """Return q(k) of each split with enough values on both sides, along the last axis."""
    n = values.shape[-1]
    k = np.arange(_MIN_SIDE, n - _MIN_SIDE + 1)
    sums = np.cumsum(values - values.mean(axis=-1, keepdims=True), axis=-1)
    return np.asarray(sums[..., _MIN_SIDE - 1 : n - _MIN_SIDE] ** 2 * (n / (k * (n - k))))


def _t_error(gain: float, total: float, n: int) -> float:
    """Return the two-sided probability of the t statistic of a split."""
    from scipy.special import stdtr

    rest = max(total - gain, _ROUNDING * total)
    return 2 * float(stdtr(n - 2, -math.sqrt(gain / rest * (n - 2))))
