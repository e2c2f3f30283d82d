"""From samples to metrics: per iteration, pooled per rate, and their range over iterations."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from r2bspec.measure.distribution_parts import (
    MAIN_PERCENTILES,
    PERCENTILES,
    TAIL_PERCENTILE,
    Distribution,
    part_value,
)
from r2bspec.measure.hop_latency import HopSamples
from r2bspec.measure.latency import Seconds
from r2bspec.measure.metrics import (
    HopMetrics,
    MonitorMetrics,
    Pace,
    PlaybackMetrics,
    RateMetrics,
    RunMetrics,
    SegmentMetrics,
    Spread,
    UseMetrics,
    pace_of,
)
from r2bspec.measure.percentiles import percentile
from r2bspec.measure.pooling import pool_monitor, pool_playback, pool_resource_use, process_names
from r2bspec.measure.resource_usage import ResourceUse
from r2bspec.measure.samples import MonitorSamples, PlaybackSamples, RunSamples, SegmentSamples


def summarise(samples: RunSamples) -> RunMetrics:
    """The metrics of samples that were read before."""
    return RunMetrics(
        rates=tuple(
            _measure_rate(rate, iterations, samples.reruns, pace_of(samples.mode))
            for rate, iterations in sorted(samples.iterations.items())
        ),
        search=samples.record.search,
        sustained=samples.record.sustained,
        incomplete=samples.incomplete,
    )


def measure_segment(samples: SegmentSamples) -> SegmentMetrics:
    """The metrics of one segment."""
    sent = 0 if samples.playback.live else samples.playback.sent
    return SegmentMetrics(
        segment=samples.segment.id,
        index=samples.segment.index,
        playback=_playback(samples.playback),
        monitors={name: _monitor(seen) for name, seen in samples.monitors.items()},
        processes={name: _use(used, sent) for name, used in samples.processes.items()},
        machine=_use(samples.machine) if samples.machine is not None else None,
        surroundings=samples.surroundings,
        start=samples.segment.start,
    )


def _measure_rate(
    rate_hz: float,
    samples: Sequence[SegmentSamples],
    reruns: Mapping[str, SegmentSamples],
    pace: Pace,
) -> RateMetrics:
    iterations = tuple(measure_segment(one) for one in samples)
    return RateMetrics(
        offered_hz=rate_hz,
        iterations=iterations,
        pooled=_pooled(samples),
        pace=pace,
        spread={name: _spread(iterations, name) for name in samples[0].monitors},
        reruns=tuple(
            measure_segment(again)
            for one in samples
            if (again := reruns.get(one.segment.id)) is not None
        ),
    )


def _pooled(samples: Sequence[SegmentSamples]) -> SegmentMetrics:
    machine = pool_resource_use(one.machine for one in samples)
    sent = sum(one.playback.sent for one in samples if not one.playback.live)
    processes = {
        name: pool_resource_use(one.processes.get(name) for one in samples)
        for name in process_names(samples)
    }
    return SegmentMetrics(
        segment="",
        index=None,
        playback=_playback(pool_playback([one.playback for one in samples])),
        monitors={
            name: _monitor(pool_monitor([one.monitors[name] for one in samples]))
            for name in samples[0].monitors
        },
        processes={name: _use(used, sent) for name, used in processes.items() if used is not None},
        machine=_use(machine) if machine is not None else None,
    )


def _spread(iterations: Sequence[SegmentMetrics], monitor: str) -> dict[str, Spread]:
    """The range over the iterations of the main metrics."""
    seen = [one.monitors[monitor] for one in iterations]
    columns: dict[str, list[float | None]] = {
        "throughput.mean": [one.throughput_hz for one in seen],
        **{
            f"latency.{part}": [part_value(one.latency, part) for one in seen]
            for part in ("mean", *MAIN_PERCENTILES, "max")
        },
        f"jitter.{TAIL_PERCENTILE}": [part_value(one.jitter, TAIL_PERCENTILE) for one in seen],
        "drop_rate": [one.drop_rate for one in seen],
    }
    known = {
        name: [value for value in values if value is not None] for name, values in columns.items()
    }
    return {
        name: Spread(low=min(values), high=max(values)) for name, values in known.items() if values
    }


def _monitor(seen: MonitorSamples) -> MonitorMetrics:
    def known(count: int) -> int | None:
        return None if seen.live else count

    return MonitorMetrics(
        sent=known(seen.sent),
        answered=known(seen.answered),
        missed=known(seen.missed),
        drop_rate=seen.missed / seen.expected if seen.expected and not seen.live else None,
        received=seen.received,
        duplicates=known(seen.duplicates),
        reordered=known(seen.reordered),
        unmatched=known(seen.unmatched),
        throughput_hz=seen.throughput_hz,
        latency=distribution(seen.times["latency"]),
        latency_from_due=distribution(seen.times["latency_from_due"]),
        interval=distribution(seen.times["interval"]),
        jitter=distribution(seen.times["jitter"]),
        late=known(seen.late),
        early=known(seen.early),
        overdue=known(seen.overdue),
        surplus=known(seen.surplus),
        untimed=seen.untimed,
        unknown_latency=seen.unknown_latency,
        hops=tuple(map(_hop, seen.hops)),
    )


def _hop(hop: HopSamples) -> HopMetrics:
    return HopMetrics(
        source=hop.source,
        target=hop.target,
        matched=int(hop.times.size),
        missed=hop.missed,
        latency=distribution(hop.times),
    )


def _playback(played: PlaybackSamples) -> PlaybackMetrics:
    return PlaybackMetrics(
        sent=None if played.live else played.sent,
        rate_hz=None if played.live else played.rate_hz,
        lateness=distribution(played.lateness),
    )


def _use(used: ResourceUse, sent: int = 0) -> UseMetrics:
    """The use of a process while this number of steps was played."""
    known = used.minor_faults is not None and sent > 0
    return UseMetrics(
        cpu_mean=used.cpu_mean,
        cpu_max=used.cpu_max,
        memory_max_bytes=used.memory_max_bytes,
        faults_per_message=(used.minor_faults or 0.0) / sent if known else None,
    )


def distribution(times: Seconds) -> Distribution:
    """Summarise times in seconds; every part is None if there are none."""
    return Distribution(
        n=int(times.size),
        min=percentile(times, 0.0),
        mean=float(times.mean()) if times.size else None,
        max=percentile(times, 1.0),
        **{part: percentile(times, q) for part, q in PERCENTILES.items()},
    )
