"""The metrics of a run: frozen values that serialise to JSON, computed from samples.

Times are seconds, rates hertz, sizes bytes and shares fractions of one; of processor time, one core
is 1. None means no value: nothing arrived, or nothing was sampled. Samples become metrics per
iteration, pooled per rate, and as a range over the iterations. Pooling adds counts, joins messages,
and averages rates.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Final, Literal

import msgspec
import numpy as np
from msgspec.structs import replace

from r2bspec.judge.measure.distribution import PERCENTILES, Distribution, part_value
from r2bspec.judge.measure.host_usage import HostInterference
from r2bspec.judge.measure.metric import MetricInfo, Scope
from r2bspec.judge.measure.metric_catalogue import WHOLE_GRAPH, measured_metric, monitor_metrics
from r2bspec.judge.measure.metric_declarations import DECLARED
from r2bspec.judge.measure.metric_values import message_values, metric_value
from r2bspec.judge.measure.sample_table import MonitorSamples
from r2bspec.judge.measure.samples import RunSamples, SegmentSamples, pool_segments
from r2bspec.judge.measure.times import Seconds, rank
from r2bspec.record.run_record import Probe, SearchRecord

MetricValue = Distribution | int | float | None
"""The distribution of the values of single messages, or one value; None is unknown."""


class MeasuredValues(msgspec.Struct, frozen=True, kw_only=True):
    """The values of declared metrics.

    Attributes:
        values: by the name of the metric, without a part where it has a distribution.
    """

    values: dict[str, MetricValue]

    def value(self, info: MetricInfo) -> float | None:
        """Return the value of a metric in one of its listed parts."""
        found = self.values.get(info.name, self.values.get(info.series))
        return part_value(found, info.part) if isinstance(found, Distribution) else found

    def number(self, name: str) -> float | None:
        """Return the value of a metric that has one value; None if it is unknown."""
        found = self.values.get(name)
        return None if isinstance(found, Distribution) else found

    def count(self, name: str) -> int:
        """Return a count; 0 if it is unknown."""
        return int(self.number(name) or 0)

    def times(self, name: str) -> Distribution:
        """Return the distribution of the values of single messages."""
        found = self.values.get(name)
        return found if isinstance(found, Distribution) else _NOTHING


class MonitorMetrics(MeasuredValues, frozen=True, kw_only=True):
    """The values of all declared metrics of a monitor.

    Attributes:
        own_period_s: the period at which outputs come whether inputs do or not, in seconds; None
            where they follow the inputs (`r2bspec.judge.measure.own_pace`).
        fitting_match: the ratio or the match that fits the outputs where those of the monitor do
            not, as a sentence; else empty.
        unknown_latency: why there is no latency though there are answers; empty if there is one.
    """

    unknown_latency: str = ""
    own_period_s: float | None = None
    fitting_match: str = ""

    @property
    def is_expected(self) -> bool:
        """Whether a number of outputs was expected, so that missed outputs can be counted."""
        return self.number("missed") is not None

    @property
    def expected(self) -> int:
        """The number of expected outputs; 0 if none was expected."""
        return self.count("answered") + self.count("missed")

    @property
    def throughput_hz(self) -> float:
        """The throughput."""
        return self.number("throughput.mean") or 0.0

    @property
    def drop_rate(self) -> float | None:
        """The share of the expected outputs that were missed."""
        return self.number("drop_rate")

    @property
    def latency(self) -> Distribution:
        """The latencies of the outputs that arrived."""
        return self.times("latency")


class SegmentMetrics(MeasuredValues, frozen=True, kw_only=True):
    """An iteration, or several pooled iterations (then `segment` is empty and `index` is None).

    `values` has the metrics that belong to no monitor: of the playback, of processes, of the
    machine, and of what was observed from inside, such as ``cpu.relay.mean`` and ``blur.callback``.

    Attributes:
        interference: the host interference, if it was sampled; None if pooled.
        start: the number of the start in which it was played, from 1; 0 if pooled.
    """

    segment: str
    index: int | None
    monitors: dict[str, MonitorMetrics]
    interference: HostInterference | None = None
    start: int = 0

    def entries(self, *scopes: Scope) -> Iterator[tuple[str, MetricInfo, MetricValue]]:
        """Yield the values of metrics, or of those of some scopes, with their names and metrics."""
        for name, value in self.values.items():
            info = measured_metric(name)
            if info is not None and (not scopes or info.scope in scopes):
                yield name, info, value


class Spread(msgspec.Struct, frozen=True, kw_only=True):
    """The smallest and the largest value of a metric over the iterations."""

    low: float
    high: float


Pace = Literal["rate", "recording", "source"]
"""What sets the rate of messages: the offered rate, the recording, or, in a live run, the graph's
own source."""


def pace_of(mode: str) -> Pace:
    """Return what determines the rate of messages in a playback mode."""
    paces: dict[str, Pace] = {"timeline": "recording", "live": "source"}
    return paces.get(mode, "rate")


class RateMetrics(msgspec.Struct, frozen=True, kw_only=True):
    """Everything measured at one offered rate; at 0, if `pace` is not a rate.

    `pooled` adds counts and pools single messages over all iterations; its rates and processor
    shares are the mean of the iterations' values. `spread` has, for each monitor, the range of
    metrics over the iterations, by the metric's name. `reruns` replace iterations affected by host
    interference, and are not part of these values.
    """

    offered_hz: float
    iterations: tuple[SegmentMetrics, ...]
    pooled: SegmentMetrics
    pace: Pace = "rate"
    spread: dict[str, dict[str, Spread]]
    reruns: tuple[SegmentMetrics, ...] = ()

    def __post_init__(self) -> None:
        """Check that every iteration has the monitors and processes that are pooled.

        Raises:
            ValueError: one has other monitors.
        """
        for iteration in self.iterations:
            if iteration.monitors.keys() != self.pooled.monitors.keys():
                raise ValueError(f"iteration {iteration.segment} has other monitors than its rate")


class RunMetrics(msgspec.Struct, frozen=True, kw_only=True):
    """Everything measured in a run, by offered rate in ascending order.

    `incomplete` are the iterations that were cut short; they are part of no value.
    """

    rates: tuple[RateMetrics, ...]
    search: SearchRecord | None
    sustained: tuple[Probe, ...]
    incomplete: tuple[str, ...]


def summarise(samples: RunSamples) -> RunMetrics:
    """Return the metrics of samples."""
    return RunMetrics(
        rates=tuple(
            _measure_rate(rate, iterations, samples.reruns, pace_of(samples.mode))
            for rate, iterations in sorted(samples.iterations.items())
        ),
        search=samples.record.search,
        sustained=samples.record.sustained,
        incomplete=samples.incomplete,
    )


def measure_segment(samples: SegmentSamples, *, pooled: bool = False) -> SegmentMetrics:
    """Return the metrics of a segment, or of the pooled iterations of a rate.

    A better fitting `match` of outputs is only looked for in all iterations together.
    """
    return SegmentMetrics(
        segment="" if pooled else samples.segment.id,
        index=None if pooled else samples.segment.index,
        values=_values(samples),
        monitors={
            name: _monitor(seen, seen.fitting_match if pooled and not seen.own_period_s else "")
            for name, seen in samples.monitors.items()
        },
        interference=samples.interference,
        start=0 if pooled else samples.segment.start,
    )


def _values(samples: SegmentSamples) -> dict[str, MetricValue]:
    """Return the known values of the metrics that belong to no monitor."""
    found: dict[str, MetricValue] = {}
    processes = dict.fromkeys([*samples.processes, *samples.devices, *samples.work])
    named = [name for name in processes if name and name != WHOLE_GRAPH]
    for metric in DECLARED:
        if metric.scope in {Scope.MONITOR, Scope.SEARCH, Scope.PROBE}:
            continue
        subjects = [""]
        if metric.scope is Scope.ANATOMY:
            subjects = [
                subject for series in samples.anatomy if (subject := metric.subject_in(series))
            ]
        elif metric.placeholder:
            subjects = named
        for subject in subjects:
            infos = [replace(info, subject=subject) for info in metric.infos]
            if metric.has_percentiles:
                times = message_values(infos[0], None, samples)
                if times.size:
                    found[infos[0].series] = distribution(times)
            else:
                values = {info.name: metric_value(info, None, samples) for info in infos}
                found |= {name: value for name, value in values.items() if value is not None}
    return found


def _measure_rate(
    rate_hz: float,
    samples: Sequence[SegmentSamples],
    reruns: Mapping[str, SegmentSamples],
    pace: Pace,
) -> RateMetrics:
    iterations = tuple(map(measure_segment, samples))
    return RateMetrics(
        offered_hz=rate_hz,
        iterations=iterations,
        pooled=measure_segment(pool_segments(samples), pooled=True),
        pace=pace,
        spread={name: _spread(iterations, name) for name in samples[0].monitors},
        reruns=tuple(
            measure_segment(reruns[sample.segment.id])
            for sample in samples
            if sample.segment.id in reruns
        ),
    )


def _spread(iterations: Sequence[SegmentMetrics], monitor: str) -> dict[str, Spread]:
    """Return the range over the iterations of the main metrics."""
    found: dict[str, Spread] = {}
    for info in monitor_metrics():
        values = [iteration.monitors[monitor].value(info) for iteration in iterations]
        known = [value for value in values if value is not None]
        if info.part in info.metric.range_of and known:
            found[info.name] = Spread(low=min(known), high=max(known))
    return found


def _monitor(seen: MonitorSamples, fitting_match: str) -> MonitorMetrics:
    values: dict[str, MetricValue] = {}
    for metric in DECLARED:
        if metric.scope is not Scope.MONITOR or not seen.reports(metric):
            continue
        if metric.has_percentiles:
            values[metric.name] = (
                distribution(metric.read(seen)) if seen.knows(metric) else _NOTHING
            )
        else:
            read = metric.read(seen) if seen.knows(metric) else None
            for info in metric.infos:
                values[info.name] = read[info.part] if isinstance(read, dict) else read
    return MonitorMetrics(
        values=values,
        own_period_s=seen.own_period_s,
        fitting_match=fitting_match,
        unknown_latency=seen.unknown_latency,
    )


_NOTHING: Final = Distribution(n=0, min=None, mean=None, max=None, **dict.fromkeys(PERCENTILES))


def distribution(times: Seconds) -> Distribution:
    """Summarise times in seconds; every part is None if there are none."""
    n = times.size
    if not n:
        return _NOTHING
    ranks = [rank(share, n) - 1 for share in (0.0, 1.0, *PERCENTILES.values())]
    low, high, *parts = np.sort(times)[ranks].tolist()
    percentiles = dict(zip(PERCENTILES, parts, strict=True))
    return Distribution(n=n, min=low, mean=float(times.mean()), max=high, **percentiles)
