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
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from r2bspec.judge.measure.host_usage import ResourceUse
from r2bspec.judge.measure.metric_catalogue import MetricInfo, available_live
from r2bspec.judge.measure.samples import (
    LOSS_SENSITIVE_FAMILIES,
    MonitorSamples,
    SegmentSamples,
    output_period_ns,
    samples_of_steps,
)
from r2bspec.judge.measure.times import Seconds, percentile, throughput


def metric_value(info: MetricInfo, monitor: str | None, samples: SegmentSamples) -> float | None:
    """The value of a metric in one segment, in its SI unit; None if it is unknown.

    In a live run, and of outputs with a pace of their own, every metric that depends on what was
    sent is unknown. So is the latency where outputs are matched by order and one is missing.

    Infinity where a percentile or the maximum of the latency falls on a lost message.

    Args:
        info: the metric; not one of the search or of a sequential probe.
        monitor: the monitor, for metrics of scope ``monitor``.
        samples: the segment.

    Raises:
        KeyError: there is no such monitor.
    """
    match info.scope:
        case "monitor":
            return monitor_value(info, samples.monitors[monitor or ""])
        case "playback":
            return _playback_value(info, samples)
        case "process":
            return _use_value(info, samples.processes.get(info.subject))
        case "graph":
            return _use_value(info, samples.graph)
        case "machine":
            return _use_value(info, samples.machine)
        case "work":
            used = samples.known_work(info.subject)
            return time_value(info, used, 0) if used.size else None
        case "anatomy":
            times = samples.anatomy.get(info.series)
            if times is None or not times.size:
                return None
            return time_value(info, times, samples.lost_on_paths(info))
        case _:
            raise ValueError(f"{info.name} is not a metric of a segment")


def monitor_value(info: MetricInfo, seen: MonitorSamples) -> float | None:
    """The value of a metric of scope ``monitor`` for one monitor; see `metric_value`."""
    if (seen.own_pace and not available_live(info)) or not seen.knows(info.family):
        return None
    if info.family in seen.times:
        lost = seen.missed if info.family in LOSS_SENSITIVE_FAMILIES else 0
        return time_value(info, seen.times[info.family], lost)
    match info.name:
        case "throughput.mean":
            return seen.throughput_hz
        case "drop_rate":
            return seen.missed / seen.expected if seen.expected else None
        case "received" | "missed" | "duplicates" | "reordered" | "unmatched":
            return float(getattr(seen, info.name))
    raise ValueError(f"{info.name} is not a metric of a monitor")


def _playback_value(info: MetricInfo, samples: SegmentSamples) -> float | None:
    if samples.live:
        return None
    if info.name == "sent":
        return float(samples.playback.sent)
    if info.name == "playback.rate":
        return samples.playback.rate_hz
    return time_value(info, samples.playback.lateness, 0)


def time_value(info: MetricInfo, times: Seconds, lost: int) -> float | None:
    """The part of the distribution of some times that a metric names; see `metric_value`."""
    if info.quantile is not None:
        return percentile(times, info.quantile, lost)
    if info.part == "max":
        return percentile(times, 1.0, lost)
    if not times.size:
        return None
    return float(times.min() if info.part == "min" else times.mean())


def _use_value(info: MetricInfo, used: ResourceUse | None) -> float | None:
    if used is None:
        return None
    if info.family == "memory":
        return None if used.memory_max_bytes is None else float(used.memory_max_bytes)
    return used.cpu_mean if info.part == "mean" else used.cpu_max


_ROUNDING_TOLERANCE_NS = 1_000
"""Due times are rounded: a step that is due at a window's first moment must not miss it."""

_WINDOW_METRICS = ("throughput.mean", "drop_rate", "missed")
"""Metrics of a monitor that have a value in a window, besides those of single messages."""


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
    """Whether a metric has a value in a window."""
    if info.scope != "monitor":
        return False
    return info.name in _WINDOW_METRICS or info.dimension == "time"


def window_values(
    info: MetricInfo, monitor: str, samples: SegmentSamples, window_ns: int, worst: float
) -> WindowValues:
    """The value of a metric in each window of an iteration.

    Args:
        info: a metric for which `has_windows`.
        monitor: the monitor.
        samples: the iteration.
        window_ns: the length of a window, positive.
        worst: the value of a window that has none because outputs are missing.

    Raises:
        KeyError: there is no such monitor.
    """
    if samples.monitors[monitor].own_pace:
        return _values_at_own_pace(info, samples.monitors[monitor], samples, window_ns)
    values: list[float] = []
    lost: list[float] = []
    without = 0
    whole = samples.monitors[monitor]
    # A timeline has no period: its windows have as many steps as were recorded in them.
    paced = bool(samples.segment.rate_hz)
    period_ns = output_period_ns(samples.segment, whole.sent, whole.per_step) if paced else 0.0
    for seen in windows(whole, samples.segment.ended_ns, window_ns, period_ns):
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


def _values_at_own_pace(
    info: MetricInfo, seen: MonitorSamples, samples: SegmentSamples, window_ns: int
) -> WindowValues:
    """The values where nothing is due: windows are cut from the beginning of the iteration on.

    In a window without messages, the throughput is 0 and the interval as long as the window.
    """
    without_messages = {"throughput": 0.0, "interval": window_ns / 1e9}
    began_ns, ended_ns = samples.segment.began_ns, samples.segment.ended_ns
    received = seen.steps.received_ns
    found: list[float] = []
    without = 0
    for start_ns in range(began_ns, ended_ns - window_ns + _ROUNDING_TOLERANCE_NS, window_ns):
        first, last = np.searchsorted(received, (start_ns, start_ns + window_ns))
        value = None
        if last > first:
            part = _cut_window(seen, slice(first, last), start_ns + window_ns, window_ns)
            in_window = throughput(np.sort(received[first:last]), start_ns, window_ns)
            value = monitor_value(info, replace(part, own_pace=True, throughput_hz=in_window))
        elif info.family in without_messages:
            value = without_messages[info.family]
        if value is None:
            without += 1
        else:
            found.append(value)
    return WindowValues(tuple(found), without)


def windows(
    seen: MonitorSamples, ended_ns: int, window_ns: int, period_ns: float = 0.0
) -> Iterator[MonitorSamples]:
    """What a monitor received, window by window.

    Duplicates, reordered and unmatched messages belong to no window: they are 0.

    Args:
        seen: one monitor in one iteration.
        ended_ns: the end of the iteration's last period.
        window_ns: the length of a window, positive.
        period_ns: the time in which one output is due; a window of 1 s at 29.97 Hz has 30 steps
            or 29, and each is then measured by the time of its steps. 0 if steps have no period.
    """
    steps = seen.steps
    if not steps.due_ns.size:
        return
    began_ns = int(steps.due_ns[0])
    number = (steps.due_ns - began_ns + _ROUNDING_TOLERANCE_NS) // window_ns
    complete = (ended_ns - began_ns + _ROUNDING_TOLERANCE_NS) // window_ns
    edges = np.searchsorted(number, np.arange(complete + 1))
    for j, (first, last) in enumerate(pairwise(edges)):
        if last > first:
            end_ns = began_ns + (j + 1) * window_ns
            yield _cut_window(seen, slice(first, last), end_ns, window_ns, period_ns)


def _cut_window(
    seen: MonitorSamples, part: slice, ended_ns: int, window_ns: int, period_ns: float = 0.0
) -> MonitorSamples:
    steps = seen.steps
    inside = steps.cut(part)
    number = int(inside.due_ns.size)
    found = samples_of_steps(inside, ended_ns, number * period_ns or window_ns, period_ns)
    return replace(found, by_order=seen.by_order, per_step=seen.per_step)
