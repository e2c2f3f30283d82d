"""The value of any metric of the catalogue in one segment."""

from __future__ import annotations

from r2bspec.measure.latency import Seconds
from r2bspec.measure.metric_catalogue import MetricInfo, available_live
from r2bspec.measure.percentiles import percentile
from r2bspec.measure.resource_usage import ResourceUse
from r2bspec.measure.samples import LOSS_SENSITIVE_FAMILIES, MonitorSamples, SegmentSamples


def metric_value(info: MetricInfo, monitor: str | None, samples: SegmentSamples) -> float | None:
    """The value of a metric in one segment, in its SI unit; None if it is unknown.

    In a live run, every metric that depends on what was sent is unknown. So is the latency where
    outputs are matched by order and one is missing.

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
            return _use_value(info, samples.processes.get(info.process))
        case "machine":
            return _use_value(info, samples.machine)
        case _:
            raise ValueError(f"{info.name} is not a metric of a segment")


def monitor_value(info: MetricInfo, seen: MonitorSamples) -> float | None:
    """The value of a metric of scope ``monitor`` for one monitor; see `metric_value`."""
    if (seen.live and not available_live(info)) or not seen.knows(info.family):
        return None
    if info.family in seen.times:
        lost = seen.missed if info.family in LOSS_SENSITIVE_FAMILIES else 0
        return _time_value(info, seen.times[info.family], lost)
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
    return _time_value(info, samples.playback.lateness, 0)


def _time_value(info: MetricInfo, times: Seconds, lost: int) -> float | None:
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
