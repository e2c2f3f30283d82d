"""By how much the levels of iterations and starts leave a percentile open.

The binomial test counts messages, and estimates from the counts by how much iterations differ
(`effective_sample_size`). Of a p99 it has a few bad messages in each iteration, hardly enough to
see that iterations differ, and not enough to see that each resembles the one before. The bulk of
the messages shows both far better: whatever makes an iteration or a start slower as a whole moves
its middle, too.

The level u of an iteration (or start) is the mean of the middle half of its values. With the
standard deviation s of m levels, F by their correlation in time (`autocorrelation`), and t at the
confidence c, the percentile q of all messages is open by at least

    h = t_c s sqrt(F) sqrt(1 / m + z^2 s^2 / (s^2 + e^2) / (2 (m - 1))).

The first part is the interval of a mean over m values. The second is for a high or low percentile
of a mixture, which lies z = |Phi^-1(q)| standard deviations sqrt(s^2 + e^2) from its middle, where
e (1.4826 times the median absolute deviation from the level) is that of the messages of one
iteration: s has a standard error of s / sqrt(2 (m - 1)).

Where there are several starts, h is the larger one of starts and iterations, and only starts may be
correlated: two iterations of one start resemble each other anyway.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from r2bspec.judge.statistics.autocorrelation import serial_degrees_of_freedom, serial_inflation

_MAD_TO_DEVIATION = 1.4826
_MIN_LEVELS = 2


@dataclass(frozen=True)
class LevelMargin:
    """By how much a percentile is open because levels differ.

    Attributes:
        half: h above, in the unit of the values.
        deviation: the standard deviation s of the levels.
        number: m.
        pieces: what has these levels.
        inflation: F, by the correlation of the levels in time.
    """

    half: float
    deviation: float
    number: int
    pieces: Literal["iterations", "starts"]
    inflation: float


def level_margin(
    values: Sequence[NDArray[np.float64]], starts: Sequence[int], q: float, confidence: float
) -> LevelMargin | None:
    """The margin of a percentile of all values.

    Args:
        values: one array for each iteration.
        starts: the start of each iteration; empty where all belong to one.
        q: the percentile, 0 < q < 1.
        confidence: of a bound, one-sided.

    Returns:
        None with fewer than two levels, or where the middle half of one is lost.
    """
    kept = [one for one in values if one.size]
    numbers = [start for start, one in zip(starts, values, strict=False) if one.size]
    groups = _by_start(kept, numbers) if len(set(numbers)) >= _MIN_LEVELS else []
    levels = [_middle(one) for one in kept]
    if len(kept) < _MIN_LEVELS or not all(map(math.isfinite, levels)):
        return None
    inside = _deviation_within(kept, levels)
    found = [_margin(levels, inside, q, confidence, "iterations", serial=not groups)]
    if groups:
        by_start = [_middle(one) for one in groups]
        found.append(_margin(by_start, inside, q, confidence, "starts", serial=True))
    return max(found, key=lambda one: one.half)


def _by_start(
    values: Sequence[NDArray[np.float64]], starts: Sequence[int]
) -> list[NDArray[np.float64]]:
    return [
        np.concatenate([one for one, own in zip(values, starts, strict=True) if own == start])
        for start in dict.fromkeys(starts)
    ]


def _middle(values: NDArray[np.float64]) -> float:
    """The mean of the middle half; infinite if a value of that is lost."""
    cut = values.size // 4
    middle = np.sort(values)[cut : values.size - cut]
    # An exact sum: its digits do not depend on the processor.
    return math.fsum(middle) / middle.size if np.isfinite(middle).all() else math.inf


def _deviation_within(values: Sequence[NDArray[np.float64]], levels: Sequence[float]) -> float:
    apart = [np.abs(one - level) for one, level in zip(values, levels, strict=True)]
    return _MAD_TO_DEVIATION * float(np.median(np.concatenate(apart)))


def _margin(
    levels: Sequence[float],
    inside: float,
    q: float,
    confidence: float,
    pieces: Literal["iterations", "starts"],
    *,
    serial: bool,
) -> LevelMargin:
    from scipy.special import ndtri, stdtrit

    m = len(levels)
    mean = math.fsum(levels) / m
    variance = math.fsum((level - mean) ** 2 for level in levels) / (m - 1)
    inflation = serial_inflation(levels) if serial else 1.0
    total = variance + inside**2
    reach = float(ndtri(q)) ** 2 * variance / total / (2 * (m - 1)) if total > 0 else 0.0
    t = float(stdtrit(serial_degrees_of_freedom(m, inflation), confidence))
    half = t * math.sqrt(variance * inflation * (1 / m + reach))
    return LevelMargin(half, math.sqrt(variance), m, pieces, inflation)
