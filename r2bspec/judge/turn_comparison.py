"""Judges a requirement of the baseline by starts of both sides that were played by turns.

A start of both sides gives one ratio of head to base for a metric:

    median (p50) of work or latency     the median of the ratios of neighbouring steps
    mean, other percentiles up to p95   the ratio of the values of both sides over the same turns
    CPU, throughput

Neighbouring steps are milliseconds apart and see the same machine, so that its changes of speed are
in both of them. Tails above p95, drops and the peak need more messages than turns have: they are
judged on the sides played alone, in pairs (`r2bspec.judge.pair_comparison`).

The ratios of the starts decide. About one start in 25 on a shared machine deviates by 10 to 20 %,
so that from six starts on the smallest and the largest logarithm are left out. With x the sorted
logarithms of n starts, h = n - 2, the trimmed mean m of the h in the middle, and s the deviation of
all n after the smallest and the largest were set to their neighbours (Winsorised), the bounds are

    m ± t(h - 1) s sqrt((n - 1) / (h (h - 1)))

(Yuen, "The two-sample trimmed t for unequal population variances", Biometrika 61, 1974.)
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

import numpy as np

from r2bspec.judge.measure.metric import MetricInfo, Scope
from r2bspec.judge.measure.metric_catalogue import WHOLE_GRAPH
from r2bspec.judge.measure.metric_values import metric_value, values_with_lost
from r2bspec.judge.measure.samples import RunSamples, SegmentSamples
from r2bspec.judge.measure.times import Seconds
from r2bspec.judge.statistics.t_interval import (
    MeanInterval,
    RatioInterval,
    mean_interval,
    t_quantile,
)

TRIMMED_FROM: Final = 6
"""Starts from which on the smallest and the largest ratio are left out."""

_HIGHEST_QUANTILE: Final = 0.95


def can_be_played_by_turns(info: MetricInfo) -> bool:
    """Return True for a metric whose ratio is measured by turns."""
    if not info.metric.by_turns:
        return False
    return info.part == "mean" or (info.quantile is not None and info.quantile <= _HIGHEST_QUANTILE)


def turn_values(
    info: MetricInfo, monitor: str | None, at_hz: float | None, base: RunSamples, head: RunSamples
) -> tuple[float | None, float | None]:
    """Return the value of the base, and that of the head, of one start of both sides.

    Their ratio is that of the metric; see the module. None where a side has no value.
    """
    before, after = base.turns_at(at_hz), head.turns_at(at_hz)
    if before is None or after is None:
        return None, None
    values = metric_value(info, monitor, before), metric_value(info, monitor, after)
    if info.quantile != 0.5 or values[0] is None:
        return values
    ratio = _median_ratio(_steps(info, monitor, before), _steps(info, monitor, after))
    return values if ratio is None else (values[0], values[0] * ratio)


def _steps(info: MetricInfo, monitor: str | None, played: SegmentSamples) -> Seconds:
    """The values of a metric by step; NaN where a step has none."""
    if info.scope is Scope.WORK:
        return played.work.get(info.subject or WHOLE_GRAPH, np.empty(0))
    seen = played.monitors[monitor or ""]
    if not seen.knows(info.metric) or seen.expected != played.playback.sent:
        return np.empty(0)
    return values_with_lost(info, monitor, played, math.nan)


def _median_ratio(base: Seconds, head: Seconds) -> float | None:
    """The median of the ratios of neighbouring steps; None if there are none."""
    steps = min(base.size, head.size)
    base, head = base[:steps], head[:steps]
    known = (base > 0) & (head > 0)
    return float(np.median(head[known] / base[known])) if known.any() else None


def ratio_of_starts(
    base: Sequence[float], head: Sequence[float], confidence: float
) -> RatioInterval:
    """Return the ratio head / base over starts of both sides, with its one-sided bounds.

    Args:
        base: a positive value for each start, at least two.
        head: the same for the head.
        confidence: of each bound by itself.
    """
    logarithms = [math.log(after / before) for before, after in zip(base, head, strict=True)]
    interval = trimmed_interval(logarithms, confidence)
    return RatioInterval.of_logarithms(
        interval.mean, interval.lower, interval.upper, interval.deviation, len(logarithms)
    )


def trimmed_interval(values: Sequence[float], confidence: float) -> MeanInterval:
    """Return the trimmed mean with its one-sided bounds; see the module.

    Raises:
        ValueError: fewer than two values.
    """
    n = len(values)
    if n < TRIMMED_FROM:
        return mean_interval(values, confidence)
    ordered = sorted(values)
    middle = ordered[1:-1]
    h = len(middle)
    mean = math.fsum(middle) / h
    winsorised = [middle[0], *middle, middle[-1]]
    deviation = float(np.std(winsorised, ddof=1))
    half = t_quantile(h - 1, confidence) * deviation * math.sqrt((n - 1) / (h * (h - 1)))
    return MeanInterval(mean=mean, lower=mean - half, upper=mean + half, deviation=deviation)
