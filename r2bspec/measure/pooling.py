"""Several iterations as one: counts added, messages pooled, rates averaged."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence

import numpy as np

from r2bspec.measure.hop_latency import pool_hops
from r2bspec.measure.resource_usage import ResourceUse
from r2bspec.measure.samples import MonitorSamples, PlaybackSamples, SegmentSamples, StepTimes


def pool_monitor(samples: Sequence[MonitorSamples]) -> MonitorSamples:
    """One monitor over several iterations, at least one.

    Times are concatenated, so that each message weighs the same; no interval spans two
    iterations. The throughput is the mean of the iterations' throughputs.
    """

    def total(count: Callable[[MonitorSamples], int]) -> int:
        return sum(count(one) for one in samples)

    return MonitorSamples(
        steps=StepTimes(
            due_ns=np.concatenate([one.steps.due_ns for one in samples]),
            published_ns=np.concatenate([one.steps.published_ns for one in samples]),
            received_ns=np.concatenate([one.steps.received_ns for one in samples]),
        ),
        times={
            family: np.concatenate([one.times[family] for one in samples])
            if all(one.knows(family) for one in samples)
            else np.empty(0)
            for family in samples[0].times
        },
        sent=total(lambda one: one.sent),
        answered=total(lambda one: one.answered),
        received=total(lambda one: one.received),
        duplicates=total(lambda one: one.duplicates),
        reordered=total(lambda one: one.reordered),
        unmatched=total(lambda one: one.unmatched),
        throughput_hz=sum(one.throughput_hz for one in samples) / len(samples),
        late=total(lambda one: one.late),
        early=total(lambda one: one.early),
        overdue=total(lambda one: one.overdue),
        surplus=total(lambda one: one.surplus),
        by_order=samples[0].by_order,
        untimed=total(lambda one: one.untimed),
        per_step=samples[0].per_step,
        hops=pool_hops([one.hops for one in samples]),
        live=samples[0].live,
    )


def pool_playback(samples: Sequence[PlaybackSamples]) -> PlaybackSamples:
    """The playback of several iterations, at least one; its rate is the mean of theirs."""
    return PlaybackSamples(
        sent=sum(one.sent for one in samples),
        rate_hz=sum(one.rate_hz for one in samples) / len(samples),
        lateness=np.concatenate([one.lateness for one in samples]),
        planned_hz=sum(one.planned_hz for one in samples) / len(samples),
        live=samples[0].live,
    )


def pool_resource_use(samples: Iterable[ResourceUse | None]) -> ResourceUse | None:
    """The mean of the means, the largest of the maxima, the sum of the counts; None without any."""
    known = [one for one in samples if one is not None]
    if not known:
        return None
    means = [one.cpu_mean for one in known if one.cpu_mean is not None]
    busiest = [one.cpu_max for one in known if one.cpu_max is not None]
    memory = [one.memory_max_bytes for one in known if one.memory_max_bytes is not None]
    faults = [one.minor_faults for one in known if one.minor_faults is not None]
    return ResourceUse(
        cpu_mean=sum(means) / len(means) if means else None,
        cpu_max=max(busiest, default=None),
        memory_max_bytes=max(memory, default=None),
        minor_faults=sum(faults) if faults else None,
    )


def process_names(samples: Sequence[SegmentSamples]) -> tuple[str, ...]:
    """The processes that were sampled in any of the segments, in order of appearance."""
    return tuple(dict.fromkeys(name for one in samples for name in one.processes))
