"""The interval of a mean over a hierarchical sample: iterations in starts.

A run with several starts of the graph's processes has two sources of variation. Starts differ
(memory layout, order of discovery, placement of threads), and iterations of one start differ, too.
What varies from start to start is known from so many values as there are starts, however many
iterations each has: the interval is that of t over the means of the starts (Kalibera and Jones,
"Rigorous benchmarking in reasonable time", ISMM 2013, which has a level for each source). By chance
the means of few starts agree better than their iterations, so t over all iterations is worked out,
too, and the wider interval counts.

The highest level may be correlated in time (`autocorrelation`): starts, or the iterations of a
single start. Iterations of one start resemble each other anyway, which t over starts covers.
"""

from __future__ import annotations

import statistics
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

from r2bspec.judge.statistics.autocorrelation import serial_inflation
from r2bspec.judge.statistics.t_interval import MeanInterval, mean_interval


@dataclass(frozen=True)
class HierarchicalInterval:
    """The interval of a mean, and what it counts: `number` iterations or starts, with their F."""

    interval: MeanInterval
    pieces: Literal["iterations", "starts"]
    number: int
    inflation: float


def hierarchical_interval(
    values: Sequence[float], starts: Sequence[int], confidence: float, resolution: float = 0.0
) -> HierarchicalInterval:
    """The wider interval of starts and iterations.

    Args:
        values: one for each iteration, at least two, in the order of time.
        starts: the start of each iteration.
        confidence: of each bound by itself.
        resolution: of a value; see `mean_interval`.

    Raises:
        ValueError: fewer than two values.
    """
    numbers = list(dict.fromkeys(starts))
    serial = len(numbers) < 2
    inflation = serial_inflation(values) if serial else 1.0
    found = HierarchicalInterval(
        mean_interval(values, confidence, resolution, inflation),
        "iterations",
        len(values),
        inflation,
    )
    if serial:
        return found
    means = [
        statistics.fmean(value for value, own in zip(values, starts, strict=True) if own == number)
        for number in numbers
    ]
    inflation = serial_inflation(means)
    by_start = mean_interval(means, confidence, resolution, inflation)
    if _width(by_start) < _width(found.interval):
        return found
    return HierarchicalInterval(by_start, "starts", len(means), inflation)


def _width(interval: MeanInterval) -> float:
    return interval.upper - interval.lower
