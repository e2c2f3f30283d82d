"""The value of any metric of the catalogue in one segment."""

from __future__ import annotations

from typing import Any, Final

import numpy as np

from r2bspec.judge.measure.metric import MetricInfo, Scope
from r2bspec.judge.measure.metric_catalogue import WHOLE_GRAPH
from r2bspec.judge.measure.sample_table import MonitorSamples
from r2bspec.judge.measure.samples import SegmentSamples
from r2bspec.judge.measure.times import Seconds, percentile


def metric_value(info: MetricInfo, monitor: str | None, samples: SegmentSamples) -> float | None:
    """Return the value of a metric in a segment, in its SI unit; None if it is unknown.

    In a live run, and for outputs with a pace of their own, every metric that depends on sent
    messages is unknown. So is the latency if outputs are matched by order and one is missing.

    Infinity where a percentile or the maximum of the latency falls on a lost message.

    Args:
        info: the metric; not one of the search or of a sequential probe.
        monitor: the monitor, for metrics of scope ``monitor``.
        samples: the segment.

    Raises:
        KeyError: there is no such monitor.
    """
    if info.scope is Scope.MONITOR:
        return monitor_value(info, samples.monitors[monitor or ""])
    if info.scope is Scope.ANATOMY and not samples.anatomy.get(info.series, _NOTHING).size:
        return None
    measured = _measured(info, samples)
    if measured is None:
        return None
    return _value(info, info.metric.read(measured), lost_outputs(info, monitor, samples))


def monitor_value(info: MetricInfo, samples: MonitorSamples) -> float | None:
    """Return the value of a metric of scope ``monitor`` for one monitor; see `metric_value`."""
    if not samples.knows(info.metric):
        return None
    return _value(
        info, info.metric.read(samples), samples.missed if info.metric.lost_is_slowest else 0
    )


def _measured(info: MetricInfo, samples: SegmentSamples) -> Any:
    """Return what a metric that belongs to no monitor is measured of in a segment.

    None for nothing.
    """
    match info.scope:
        case Scope.PLAYBACK:
            return None if samples.live else samples.playback
        case Scope.PROCESS:
            return samples.processes.get(info.subject)
        case Scope.GRAPH:
            return samples.graph
        case Scope.MACHINE:
            return samples.machine
        case Scope.DEVICE:
            return samples.devices.get(info.subject)
        case Scope.WORK:
            return samples.known_work(info.subject or WHOLE_GRAPH)
        case Scope.ANATOMY:
            return samples.anatomy.get(info.series, _NOTHING)
        case _:
            raise ValueError(f"{info.name} is not a metric of a segment")


def _value(info: MetricInfo, read: Any, lost: int) -> float | None:
    """Return the part of what a declaration returned that a metric names."""
    if isinstance(read, np.ndarray):
        return time_value(info, read, lost)
    value = read[info.part] if isinstance(read, dict) else read
    return None if value is None else float(value)


def time_value(info: MetricInfo, times: Seconds, lost: int) -> float | None:
    """Return the part of a distribution of times that a metric names; see `metric_value`."""
    if info.quantile is not None:
        return percentile(times, info.quantile, lost)
    if info.part == "max":
        return percentile(times, 1.0, lost)
    if not times.size:
        return None
    return float(times.min() if info.part == "min" else times.mean())


_NOTHING: Final = np.empty(0)


def message_values(info: MetricInfo, monitor: str | None, samples: SegmentSamples) -> Seconds:
    """Return the values of single messages in one segment, in their order, without lost ones."""
    measured = (
        samples.monitors[monitor or ""] if info.scope is Scope.MONITOR else _measured(info, samples)
    )
    values: Seconds = _NOTHING if measured is None else info.metric.read(measured)
    return values


def values_with_lost(
    info: MetricInfo, monitor: str | None, samples: SegmentSamples, worst: float
) -> Seconds:
    """Return the values of single messages in a segment, in order, including lost outputs.

    Args:
        info: the metric, of single messages.
        monitor: for a metric of a monitor.
        samples: the segment.
        worst: the value of an output that never came, if these count.
    """
    values, lost = message_values(info, monitor, samples), lost_outputs(info, monitor, samples)
    if not lost:
        return values
    came = samples.monitors[monitor or info.subject].came
    if not values.size or np.count_nonzero(came) != values.size:
        # Which outputs never came is not known: they are the last ones.
        came = np.arange(values.size + lost) < values.size
    whole = np.full(came.size, worst)
    whole[came] = values
    return whole


def lost_outputs(info: MetricInfo, monitor: str | None, samples: SegmentSamples) -> int:
    """Return how many expected outputs never came and count as slower than every other.

    See `Metric`.

    An output on a path without the stamp of its input answers none, but it did come.
    """
    seen = samples.monitors.get(monitor or info.subject)
    if not info.metric.lost_is_slowest or seen is None:
        return 0
    if info.scope is Scope.MONITOR:
        return seen.missed
    return max(0, min(seen.missed, seen.expected - seen.received))
