"""The samples of one segment, matched and in seconds, and those of a run."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np

from r2bspec.judge.measure.host_usage import (
    DeviceUse,
    HostInterference,
    ResourceUse,
    pool_device_use,
    pool_resource_use,
)
from r2bspec.judge.measure.metric_catalogue import NO_SUBJECTS, Subjects
from r2bspec.judge.measure.sample_table import MonitorSamples
from r2bspec.judge.measure.times import Seconds, mean_rate, seconds
from r2bspec.record.run_record import RunRecord, Segment, TurnKind
from r2bspec.record.sample_arrays import Rows

if TYPE_CHECKING:
    from r2bspec.judge.measure.anatomy_summary import AnatomySummary


def known_latencies(seen: Sequence[MonitorSamples]) -> Seconds:
    """Return the latencies of a monitor over several iterations.

    None if those of any iteration are unknown.
    """
    if any(sample.unknown_latency for sample in seen):
        return np.empty(0)
    return np.concatenate([sample.latency for sample in seen])


@dataclass(frozen=True)
class PlaybackSamples:
    """The playback: steps, the published rate, and how late each step began.

    `planned_hz` is the rate at which steps were due. A live run has no playback.
    """

    sent: int
    rate_hz: float
    lateness: Seconds
    planned_hz: float = 0.0


@dataclass(frozen=True)
class SegmentSamples:
    """A segment: playback, monitors, processes, and host interference.

    Attributes:
        graph: what the processes of the graph used together.
        work: the processor time of each step, of each process of the graph and of ``graph``; NaN
            where it is unknown, as of the last step.
        anatomy: what was observed from inside of each node and topic, by its name and the family of
            the metric, such as ``blur.callback``: the values of single messages, in seconds, in the
            order in which they began. The load has one value.
        summary: what reports show of the same.
        devices: what GPUs and processor packages did, by the process; of the machine under ``""``.
    """

    segment: Segment
    playback: PlaybackSamples
    monitors: Mapping[str, MonitorSamples]
    processes: Mapping[str, ResourceUse]
    machine: ResourceUse | None
    interference: HostInterference | None = None
    anatomy: Mapping[str, Seconds] = field(default_factory=dict)
    summary: AnatomySummary | None = None
    graph: ResourceUse | None = None
    work: Mapping[str, Seconds] = field(default_factory=dict)
    devices: Mapping[str, DeviceUse] = field(default_factory=dict)

    @property
    def live(self) -> bool:
        """Whether nothing was played."""
        return self.segment.live

    def known_work(self, process: str) -> Seconds:
        """Return the known processor times of the steps of a process."""
        used = self.work.get(process, np.empty(0))
        return used[~np.isnan(used)]


@dataclass(frozen=True)
class RunSamples:
    """A run: its complete iterations by offered rate, and the playback of sustained probes.

    Attributes:
        iterations: offered rate in Hz to the iterations at it, in the order they were played,
            each as it was played first.
        reruns: iterations that were played again because of host interference, by the id of the
            first one.
        sustained: offered rate to the samples of its sequential probe.
        incomplete: ids of the iterations that were cut short; they are not among the samples.
        confirmation: the confirmation session that was played after a failure, as a run of its own.
        peak_hz: the rate that counts as the peak: the highest sustained rate of the search.
        subjects: what there are metrics of, besides the monitors.
        turns: what was played by turns with the other side of a comparison, by kind and offered
            rate.
    """

    record: RunRecord
    monitors: tuple[str, ...]
    iterations: Mapping[float, tuple[SegmentSamples, ...]]
    sustained: Mapping[float, SegmentSamples]
    incomplete: tuple[str, ...]
    reruns: Mapping[str, SegmentSamples] = field(default_factory=dict)
    confirmation: RunSamples | None = None
    peak_hz: float | None = None
    mode: str = "looping"
    subjects: Subjects = NO_SUBJECTS
    turns: Mapping[tuple[TurnKind, float], SegmentSamples] = field(default_factory=dict)

    @property
    def own_rate(self) -> bool:
        """Whether the recording, or the graph's own source, sets the rate."""
        return self.mode in {"timeline", "live"}

    @property
    def starts(self) -> int:
        """The number of starts behind the iterations, at the rate with the fewest.

        1 if the verdict is of this start alone, or if there is no iteration.
        """
        return min(
            (len(set(starts_of(iteration))) for iteration in self.iterations.values()), default=1
        )

    @property
    def summaries(self) -> dict[str, AnatomySummary]:
        """The anatomies of the iterations that were observed from inside, by segment."""
        played = (one for iterations in self.iterations.values() for one in iterations)
        return {one.segment.id: one.summary for one in played if one.summary is not None}

    def iterations_at(self, at_hz: float | None) -> tuple[SegmentSamples, ...]:
        """Return the iterations at a rate; none without a rate."""
        if at_hz is None:
            return ()
        rates = self.iterations.items()
        return next((played for rate, played in rates if math.isclose(rate, at_hz)), ())

    def turns_at(self, kind: TurnKind, at_hz: float | None) -> SegmentSamples | None:
        """Return what was played by turns for a rate; None without turns."""
        of_kind = (
            played
            for (its_kind, rate), played in self.turns.items()
            if its_kind == kind and math.isclose(rate, at_hz or 0.0)
        )
        return next(of_kind, None)

    def with_each(self, change: Callable[[SegmentSamples], SegmentSamples | None]) -> RunSamples:
        """Return the run with its iterations changed, without those that become None."""
        iterations = {
            rate: tuple(one for one in map(change, played) if one is not None)
            for rate, played in self.iterations.items()
        }
        return replace(self, iterations=iterations)


def starts_of(iterations: Sequence[SegmentSamples]) -> tuple[int, ...]:
    """Return the number of the start in which each iteration was played."""
    return tuple(iteration.segment.start for iteration in iterations)


def playback_samples(playback: Rows) -> PlaybackSamples:
    """Return the playback from rows of type `PLAYBACK_DTYPE`, one row for each step."""
    return PlaybackSamples(
        sent=int(playback.size),
        rate_hz=mean_rate(playback["published_ns"]),
        lateness=seconds(playback["published_ns"] - playback["due_ns"]),
        planned_hz=mean_rate(playback["due_ns"]),
    )


def pool_segments(samples: Sequence[SegmentSamples]) -> SegmentSamples:
    """Join several iterations, at least one; the segment is that of the first."""
    processes = dict.fromkeys(name for sample in samples for name in sample.processes)
    used = {
        name: pool_resource_use(sample.processes.get(name) for sample in samples)
        for name in processes
    }
    observed = dict.fromkeys(name for sample in samples for name in sample.anatomy)
    return SegmentSamples(
        segment=samples[0].segment,
        playback=pool_playback([sample.playback for sample in samples]),
        monitors={
            name: MonitorSamples.joined([sample.monitors[name] for sample in samples])
            for name in samples[0].monitors
        },
        processes={name: use for name, use in used.items() if use is not None},
        machine=pool_resource_use(sample.machine for sample in samples),
        graph=pool_resource_use(sample.graph for sample in samples),
        anatomy={
            name: np.concatenate([one.anatomy[name] for one in samples if name in one.anatomy])
            for name in observed
        },
        work={
            name: np.concatenate([one.work[name] for one in samples if name in one.work])
            for name in dict.fromkeys(name for sample in samples for name in sample.work)
        },
        devices={
            name: pool_device_use([one.devices[name] for one in samples])
            for name in samples[0].devices
            if all(name in one.devices for one in samples)
        },
    )


def pool_playback(samples: Sequence[PlaybackSamples]) -> PlaybackSamples:
    """Return the playback of several iterations, at least one; its rate is their mean rate."""
    return PlaybackSamples(
        sent=sum(sample.sent for sample in samples),
        rate_hz=sum(sample.rate_hz for sample in samples) / len(samples),
        lateness=np.concatenate([sample.lateness for sample in samples]),
        planned_hz=sum(sample.planned_hz for sample in samples) / len(samples),
    )
