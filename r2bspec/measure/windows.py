"""An iteration cut into windows of equal length, each measured by itself.

With w the length of a window and t_0 when the first step of the iteration was due, window j spans

    t_0 + j w  <=  due time  <  t_0 + (j + 1) w

A step belongs to the window in which it was due, and so does its output, whenever that arrives: a
late output makes the window of its step late. What remains at the end of an iteration and is
shorter than w is an incomplete window. It is left out, with its messages: a percentile of half a
second is another quantity than one of a whole second. No window spans two iterations. A window in
which no step was due is not counted.

In a live run nothing is due. A message belongs to the window in which it was received, the first
window begins with the iteration, and a window without messages counts, too.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from r2bspec.measure.latency import intervals, jitter, seconds
from r2bspec.measure.metric_catalogue import MetricInfo
from r2bspec.measure.metric_values import monitor_value
from r2bspec.measure.samples import (
    MonitorSamples,
    SegmentSamples,
    StepTimes,
    output_period_ns,
)
from r2bspec.measure.throughput import edge_gaps, throughput

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
    if samples.live:
        return _live_values(info, samples.monitors[monitor], samples, window_ns)
    found: list[float] = []
    lost: list[float] = []
    without = 0
    whole = samples.monitors[monitor]
    # A timeline has no period: its windows have as many steps as were recorded in them.
    paced = bool(samples.segment.rate_hz)
    period_ns = output_period_ns(samples.segment, whole.sent, whole.per_step) if paced else 0.0
    for seen in windows(whole, samples.segment.ended_ns, window_ns, period_ns):
        value = monitor_value(info, seen)
        if value is not None and seen.answered:
            found.append(value)
        elif seen.missed:
            found.append(worst)
        else:
            without += 1
            continue
        lost.append(seen.missed / seen.expected)
    return WindowValues(tuple(found), without, tuple(lost))


def _live_values(
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
            value = monitor_value(info, replace(part, live=True, throughput_hz=in_window))
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

    Raises:
        ValueError: the length is not positive.
    """
    if window_ns <= 0:
        raise ValueError("the length of a window must be positive")
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
    due, published = steps.due_ns[part], steps.published_ns[part]
    received = steps.received_ns[part]
    inside = StepTimes(due, published, received)
    answered = inside.answered
    arrived = np.sort(received[answered])
    latency = seconds(received[answered] - published[answered])
    between, rate_hz = np.empty(0), 0.0
    if arrived.size:
        soonest = int(published[0]) + round(float(latency.min()) * 1e9)
        gaps = edge_gaps(arrived, soonest, ended_ns)
        ends = [gap for gap in (gaps.before_ns, gaps.after_ns) if gap]
        between = np.concatenate((intervals(arrived), seconds(np.array(ends, dtype=np.int64))))
        due_ns = due.size * period_ns or window_ns
        rate_hz = throughput(arrived, soonest, due_ns, period_ns)
    return MonitorSamples(
        steps=inside,
        times={
            "latency": latency,
            "latency_from_due": seconds(received[answered] - due[answered]),
            "interval": between,
            "jitter": jitter(arrived),
        },
        sent=int(due.size),
        answered=int(arrived.size),
        received=int(arrived.size),
        duplicates=0,
        reordered=0,
        unmatched=0,
        throughput_hz=rate_hz,
        by_order=seen.by_order,
        per_step=seen.per_step,
    )
