"""The value of any metric of the catalogue in one segment, or in windows of it of equal length.

With w the length of a window and t_0 when the first step of the iteration was due, window j spans

    t_0 + j w  <=  due time  <  t_0 + (j + 1) w

A step belongs to the window in which it was due, and so does its output, whenever that arrives: a
late output makes the window of its step late. What remains at the end of an iteration and is
shorter than w is an incomplete window. It is left out, with its messages: a percentile of half a
second is another quantity than one of a whole second. No window spans two iterations. A window in
which no step was due is not counted.

In a live run, and of outputs with a pace of their own, nothing is due. A message belongs to the
window in which it was received, the first window begins with the iteration, and a window without
messages counts, too.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, Final

import numpy as np

from r2bspec.judge.measure.metric import MetricInfo, Scope
from r2bspec.judge.measure.metric_catalogue import WHOLE_GRAPH
from r2bspec.judge.measure.sample_table import MonitorSamples, Span, output_period_ns
from r2bspec.judge.measure.samples import SegmentSamples
from r2bspec.judge.measure.times import Seconds, percentile, throughput


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


def monitor_value(info: MetricInfo, seen: MonitorSamples) -> float | None:
    """Return the value of a metric of scope ``monitor`` for one monitor; see `metric_value`."""
    if not seen.knows(info.metric):
        return None
    return _value(info, info.metric.read(seen), seen.missed if info.metric.lost_is_slowest else 0)


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
    known = samples.monitors[monitor or info.subject].came
    if not values.size or np.count_nonzero(known) != values.size:
        # Which outputs never came is not known: they are the last ones.
        known = np.arange(values.size + lost) < values.size
    whole = np.full(known.size, worst)
    whole[known] = values
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


_ROUNDING_TOLERANCE_NS = 1_000
"""Due times are rounded: a step that is due at a window's first moment must not miss it."""


@dataclass(frozen=True)
class WindowValues:
    """The values of a metric in the windows of one iteration, in order.

    Attributes:
        values: one for each window; `worst` where expected outputs are missing and there is
            no value for that reason.
        without: windows with too few messages for the metric, though none is missing.
        lost: for each value, the share of the outputs of its window that are missing.
    """

    values: tuple[float, ...]
    without: int
    lost: tuple[float, ...] = ()


def has_windows(info: MetricInfo) -> bool:
    """Return True if a metric has a value in a window."""
    return info.metric.in_windows


def window_values(
    info: MetricInfo, monitor: str, samples: SegmentSamples, window_ns: int, worst: float
) -> WindowValues:
    """Return the value of a metric in each window of an iteration.

    Args:
        info: a metric for which `has_windows`.
        monitor: the monitor.
        samples: the iteration.
        window_ns: the length of a window, positive.
        worst: the value of a window that has none because outputs are missing.

    Raises:
        KeyError: there is no such monitor.
    """
    if samples.monitors[monitor].kind != "answers":
        return _values_where_nothing_is_due(info, samples.monitors[monitor], window_ns)
    values: list[float] = []
    lost: list[float] = []
    without = 0
    for seen in windows(samples.monitors[monitor], window_ns):
        value = monitor_value(info, seen)
        if value is not None and seen.answered:
            values.append(value)
        elif seen.missed:
            values.append(worst)
        else:
            without += 1
            continue
        lost.append(seen.missed / seen.expected)
    return WindowValues(tuple(values), without, tuple(lost))


def _values_where_nothing_is_due(
    info: MetricInfo, seen: MonitorSamples, window_ns: int
) -> WindowValues:
    """The values where no number is due: windows are cut from the beginning of the iteration on.

    In a window without messages, the throughput is 0 and the interval as long as the window.
    """
    segment = seen.spans[0].segment
    received = seen.outputs["received_ns"]
    starts_ns = range(
        segment.began_ns, segment.ended_ns - window_ns + _ROUNDING_TOLERANCE_NS, window_ns
    )
    found: list[float] = []
    without = 0
    for start_ns in starts_ns:
        first, last = np.searchsorted(received, (start_ns, start_ns + window_ns))
        value = None
        if last > first:
            hz = throughput(np.sort(received[first:last]), start_ns, window_ns)
            ended_ns, number = start_ns + window_ns, int(last - first)
            span = Span(segment, number, window_ns, 0.0, ended_ns, given_hz=hz)
            value = monitor_value(info, seen.part(slice(first, last), span))
        elif info.metric.empty_window is not None:
            value = info.metric.empty_window(window_ns / 1e9)
        if value is None:
            without += 1
        else:
            found.append(value)
    return WindowValues(tuple(found), without)


def windows(seen: MonitorSamples, window_ns: int) -> Iterator[MonitorSamples]:
    """Yield the samples of a monitor in an iteration, window by window.

    A window of 1 s at 29.97 Hz has 30 steps or 29, and is then measured by the time of its steps.
    Without a period, as in a timeline, windows have as many steps as were due in them.

    Args:
        seen: one monitor in one iteration.
        window_ns: the length of a window, positive.
    """
    due_ns, segment = seen.outputs["due_ns"], seen.spans[0].segment
    if not due_ns.size:
        return
    period_ns = output_period_ns(segment, seen.sent, seen.per_step) if segment.has_period else 0.0
    began_ns = int(due_ns[0])
    number = (due_ns - began_ns + _ROUNDING_TOLERANCE_NS) // window_ns
    complete = (segment.ended_ns - began_ns + _ROUNDING_TOLERANCE_NS) // window_ns
    edges = np.searchsorted(number, np.arange(complete + 1))
    for j, (first, last) in enumerate(pairwise(edges)):
        if last > first:
            steps, ended_ns = int(last - first), began_ns + (j + 1) * window_ns
            length_ns = steps * period_ns or window_ns
            yield seen.part(
                slice(first, last), Span(segment, steps, length_ns, period_ns, ended_ns)
            )
