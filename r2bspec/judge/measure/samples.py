"""The samples of one segment, matched and in seconds, and those of a run."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import NDArray

from r2bspec.judge.measure.host_usage import HostInterference, ResourceUse, pool_resource_use
from r2bspec.judge.measure.matching import (
    NO_MATCH,
    MatchedMonitor,
    Matching,
    count_reordered,
    source_times_ns,
)
from r2bspec.judge.measure.metric import Metric
from r2bspec.judge.measure.metric_catalogue import NO_SUBJECTS, Subjects
from r2bspec.judge.measure.own_pace import PaceEvidence, own_period_s
from r2bspec.judge.measure.times import (
    Seconds,
    edge_gaps,
    intervals,
    jitter,
    mean_rate,
    seconds,
    throughput,
)
from r2bspec.record.run_record import RunRecord, Segment
from r2bspec.record.sample_arrays import Rows

if TYPE_CHECKING:
    from r2bspec.judge.measure.anatomy_summary import AnatomySummary


@dataclass(frozen=True)
class HopSamples:
    """One hop: its latency in seconds, a value for each step received at both ends, in their order.

    `missed` steps were received at `source` and not at `target`.
    """

    source: str
    target: str
    times: Seconds
    missed: int


def pool_hops(iterations: Sequence[Iterable[HopSamples]]) -> tuple[HopSamples, ...]:
    """Each hop over several iterations: messages pooled, counts added."""
    found: dict[tuple[str, str], list[HopSamples]] = {}
    for hops in iterations:
        for hop in hops:
            found.setdefault((hop.source, hop.target), []).append(hop)
    return tuple(
        HopSamples(
            source=source,
            target=target,
            times=np.concatenate([hop.times for hop in hops]),
            missed=sum(hop.missed for hop in hops),
        )
        for (source, target), hops in found.items()
    )


_FAMILIES_OF_PAIRS = ("latency", "latency_from_due", "age")
"""Families that are known only if it is known which input an output answers."""

_UNKNOWN: Final = dict.fromkeys(_FAMILIES_OF_PAIRS, np.empty(0))


@dataclass(frozen=True)
class StepTimes:
    """For each expected output: when its step was due and published, and when it was received.

    In nanoseconds; shape (expected,) each, in the order of the steps, each with one output unless
    the ratio is another. `received_ns` is `NO_MATCH` for an output that never arrived.

    `newest_ns` is when the newest input in each output was published, `NO_MATCH` where unknown;
    None stands for `published_ns`.
    """

    due_ns: NDArray[np.int64]
    published_ns: NDArray[np.int64]
    received_ns: NDArray[np.int64]
    newest_ns: NDArray[np.int64] | None = None

    @classmethod
    def joined(cls, parts: Sequence[StepTimes]) -> StepTimes:
        """Those of several segments, at least one, one after the other."""
        newest = [part.newest_ns for part in parts if part.newest_ns is not None]
        return cls(
            due_ns=np.concatenate([part.due_ns for part in parts]),
            published_ns=np.concatenate([part.published_ns for part in parts]),
            received_ns=np.concatenate([part.received_ns for part in parts]),
            newest_ns=np.concatenate(newest) if newest else None,
        )

    def cut(self, part: slice) -> StepTimes:
        """A part of them."""
        return replace(
            self,
            due_ns=self.due_ns[part],
            published_ns=self.published_ns[part],
            received_ns=self.received_ns[part],
            newest_ns=None if self.newest_ns is None else self.newest_ns[part],
        )

    @property
    def answered(self) -> NDArray[np.bool_]:
        """Whether each expected output arrived."""
        return np.not_equal(self.received_ns, NO_MATCH)

    @property
    def latency(self) -> Seconds:
        """Received - published of each output, in the order of the steps; shape (answered,).

        Published is when publishing of the step's first input began; received is when the
        middleware received the first output. Where several steps lead to one output, the last of
        them counts: the graph could not respond before.
        """
        answered = self.answered
        return seconds(self.received_ns[answered] - self.published_ns[answered])

    @property
    def latency_from_due(self) -> Seconds:
        """The same since the step was due: free of coordinated omission, delays of playback count.

        Shape (answered,).
        """
        answered = self.answered
        return seconds(self.received_ns[answered] - self.due_ns[answered])

    @property
    def age(self) -> Seconds:
        """Received - published of the newest input in each output that arrived; shape (known,)."""
        if self.newest_ns is None:
            return self.latency
        known = self.answered & (self.newest_ns != NO_MATCH)
        return seconds(self.received_ns[known] - self.newest_ns[known])

    @property
    def reordered(self) -> int:
        """Outputs that arrived after that of a later step (see `Matching`)."""
        return count_reordered(np.argsort(self.received_ns[self.answered], kind="stable"))


@dataclass(frozen=True)
class MonitorSamples:
    """What one monitor received in one segment.

    Attributes:
        steps: the expected outputs one by one.
        times: for each family of the catalogue that has one value per message (``latency``,
            ``latency_from_due``, ``age``, ``interval``, ``jitter``), the values in seconds. A gap
            at an end of the segment is among the intervals (see `times.edge_gaps`).
        sent: steps played. Each has one expected output, unless the ratio is another;
            ``expected = answered + missed``.
        received: messages; ``received = answered + duplicates + unmatched``.
        throughput_hz: see `times.throughput`.
        surplus: see `Matching`.
        by_order: whether outputs are matched by order. If one is then missing, too many or early,
            the latencies are unknown, and there are none among the times.
        untimed: messages whose time of reception is that of taking (see `MONITOR_FIELDS`).
        late: outputs that arrived after the sending window had ended.
        early: see `Matching`.
        overdue: of the unmatched, outputs of a step of an earlier segment.
        per_step: expected outputs per step, on average.
        hops: the path to the monitor, where it is tapped.
        own_pace: whether no output was expected, as in a live run, in which nothing is played, and
            with `match: own_pace`. Each message then counts as a step, and what was sent or missed
            is unknown, whatever the counts say (`r2bspec.judge.measure.matching`).
        pace: see `r2bspec.judge.measure.own_pace`; of each segment.
    """

    steps: StepTimes
    times: dict[str, Seconds]
    sent: int
    received: int
    throughput_hz: float
    duplicates: int = 0
    reordered: int = 0
    unmatched: int = 0
    late: int = 0
    early: int = 0
    overdue: int = 0
    surplus: int = 0
    by_order: bool = False
    untimed: int = 0
    per_step: float = 1.0
    hops: tuple[HopSamples, ...] = ()
    own_pace: bool = False
    pace: tuple[PaceEvidence, ...] = ()

    @property
    def expected(self) -> int:
        """The number of expected outputs."""
        return int(self.steps.due_ns.size)

    @cached_property
    def answered(self) -> int:
        """Expected outputs that arrived."""
        return int(np.count_nonzero(self.steps.answered))

    @property
    def missed(self) -> int:
        """Expected outputs that never arrived."""
        return self.expected - self.answered

    @property
    def latency_by_step(self) -> Seconds:
        """The latency of each expected output, NaN for those that never came."""
        values = np.full(self.steps.received_ns.size, math.nan)
        values[self.steps.answered] = self.times["latency"]
        return values

    @property
    def own_period_s(self) -> float | None:
        """The period of outputs that come whatever is played; None if these do not."""
        return own_period_s(self.pace, self.overdue)

    @property
    def unknown_latency(self) -> str:
        """Why the latencies are unknown, as a clause; empty if they are known.

        See `Matching.pairs_known`.
        """
        if not self.by_order:
            return ""
        faults = {
            f"{self.missed:,} of {self.expected:,} are missing": self.missed,
            f"{self.surplus:,} are more than the {self.expected:,} expected": self.surplus,
            f"{self.early:,} came before their input": self.early,
        }
        found = " and ".join(text for text, count in faults.items() if count)
        return f"outputs are matched by order, and {found}" if found else ""

    def knows(self, metric: Metric) -> bool:
        """Whether a metric is known of these outputs."""
        if self.own_pace and not metric.live:
            return False
        return not (metric.of_pairs and self.unknown_latency)


def known_latencies(seen: Sequence[MonitorSamples]) -> Seconds:
    """The latencies of a monitor over several iterations; none if those of one are unknown."""
    if any(sample.unknown_latency for sample in seen):
        return np.empty(0)
    return np.concatenate([sample.times["latency"] for sample in seen])


@dataclass(frozen=True)
class PlaybackSamples:
    """What was played: steps, the published rate, and how late each step began.

    `planned_hz` is the rate at which steps were due. A live run has no playback.
    """

    sent: int
    rate_hz: float
    lateness: Seconds
    planned_hz: float = 0.0


@dataclass(frozen=True)
class SegmentSamples:
    """One segment: playback, monitors, processes, and host interference.

    Attributes:
        graph: what the processes of the graph used together.
        work: the processor time of each step, of each process of the graph and of ``graph``; NaN
            where it is unknown, as of the last step.
        anatomy: what was observed from inside of each node and topic, by its name and the family of
            the metric, such as ``blur.callback``: the values of single messages, in seconds, in the
            order in which they began. The load has one value.
        summary: what reports show of the same.
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

    @property
    def live(self) -> bool:
        """Whether nothing was played."""
        return self.segment.live

    def known_work(self, process: str) -> Seconds:
        """Return the processor time of the steps of a process for which it is known."""
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
        turns: offered rate to what was played by turns with the other side of a comparison.
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
    turns: Mapping[float, SegmentSamples] = field(default_factory=dict)

    @property
    def own_rate(self) -> bool:
        """Whether the recording, or the graph's own source, sets the rate."""
        return self.mode in {"timeline", "live"}

    @property
    def starts(self) -> int:
        """Starts of the graph's processes behind the iterations, at the rate with the fewest.

        1 where the verdict is of this start alone; also without any iteration.
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
        """The iterations at a rate; none if there is no rate."""
        if at_hz is None:
            return ()
        rates = self.iterations.items()
        return next((played for rate, played in rates if math.isclose(rate, at_hz)), ())

    def turns_at(self, at_hz: float | None) -> SegmentSamples | None:
        """Return what was played by turns for a rate; None if nothing was."""
        found = (turns for rate, turns in self.turns.items() if math.isclose(rate, at_hz or 0.0))
        return next(found, None)

    def with_each(self, change: Callable[[SegmentSamples], SegmentSamples | None]) -> RunSamples:
        """The run with each iteration as it is changed, without those that become None."""
        iterations = {
            rate: tuple(one for one in map(change, played) if one is not None)
            for rate, played in self.iterations.items()
        }
        return replace(self, iterations=iterations)


def starts_of(iterations: Sequence[SegmentSamples]) -> tuple[int, ...]:
    """The start of the graph's processes that each iteration was played in."""
    return tuple(iteration.segment.start for iteration in iterations)


def samples_of_steps(
    steps: StepTimes, ended_ns: int, window_ns: float, period_ns: float
) -> MonitorSamples:
    """What follows from when the outputs of a segment, or of a part of it, came.

    Args:
        steps: the expected outputs.
        ended_ns: the end of the time in which they were due.
        window_ns: see `r2bspec.judge.measure.times.throughput`.
        period_ns: likewise.
    """
    latency, arrived = steps.latency, np.sort(steps.received_ns[steps.answered])
    between, rate_hz = np.empty(0), 0.0
    if arrived.size:
        soonest = int(steps.published_ns[0]) + round(float(latency.min()) * 1e9)
        between = intervals_with_edge_gaps(arrived, soonest, ended_ns)
        rate_hz = throughput(arrived, soonest, window_ns, period_ns)
    times = {
        "latency": latency,
        "latency_from_due": steps.latency_from_due,
        "age": latency if steps.newest_ns is None else steps.age,
        "interval": between,
        "jitter": jitter(arrived),
    }
    return MonitorSamples(
        steps=steps,
        times=times,
        sent=int(steps.due_ns.size),
        received=int(arrived.size),
        throughput_hz=rate_hz,
    )


def late_outputs(segment: Segment, steps: StepTimes) -> int:
    """How many outputs arrived after the segment."""
    return int(np.count_nonzero(steps.received_ns[steps.answered] > segment.ended_ns))


def monitor_samples(segment: Segment, matched_monitor: MatchedMonitor) -> MonitorSamples:
    """The counts and times of one monitor in one segment."""
    playback, monitor = matched_monitor.steps, matched_monitor.rows
    if matched_monitor.own_pace:
        return _own_pace_samples(segment, matched_monitor)
    matched = matched_monitor.matching
    steps = step_times(playback, monitor, matched)
    period_ns = output_period_ns(segment, int(playback.size), matched.per_step)
    window_ns = matched.trigger_steps.size * period_ns
    seen = samples_of_steps(steps, segment.began_ns + round(window_ns), window_ns, period_ns)
    return replace(
        seen,
        times=seen.times if matched.pairs_known else seen.times | _UNKNOWN,
        sent=int(playback.size),
        received=int(monitor.size),
        duplicates=matched.duplicates,
        reordered=matched.reordered,
        unmatched=matched.unmatched,
        late=late_outputs(segment, steps),
        early=matched.early,
        surplus=matched.surplus,
        by_order=matched.by_order,
        untimed=_untimed(monitor),
        per_step=matched.per_step,
        pace=matched_monitor.pace_evidence(segment),
    )


def output_period_ns(segment: Segment, steps: int, per_step: float) -> float:
    """The time in which one output is due, on average, in a segment with these steps.

    Steps after the last whole group of a ratio have no expected output, and no time either.
    """
    return (segment.ended_ns - segment.began_ns) / (steps * per_step) if steps else 0.0


def step_times(playback: Rows, monitor: Rows, matched: Matching) -> StepTimes:
    """When each expected output was due, published and received."""
    received = np.full(matched.trigger_steps.size, NO_MATCH, dtype=np.int64)
    answered = matched.answered
    received[answered] = monitor["received_ns"][matched.first_row[answered]]
    steps = matched.trigger_steps
    return StepTimes(playback["due_ns"][steps], playback["published_ns"][steps], received)


def intervals_with_edge_gaps(arrived: NDArray[np.int64], soonest_ns: int, ended_ns: int) -> Seconds:
    """The intervals between outputs, and the gaps at the ends that count (see `edge_gaps`)."""
    if not arrived.size:
        return np.empty(0)
    ends = [gap for gap in edge_gaps(arrived, soonest_ns, ended_ns) if gap]
    return np.concatenate((intervals(arrived), seconds(np.array(ends, dtype=np.int64))))


def playback_samples(playback: Rows) -> PlaybackSamples:
    """What was played: rows of type `PLAYBACK_DTYPE`, one per step."""
    return PlaybackSamples(
        sent=int(playback.size),
        rate_hz=mean_rate(playback["published_ns"]),
        lateness=seconds(playback["published_ns"] - playback["due_ns"]),
        planned_hz=mean_rate(playback["due_ns"]),
    )


def live_samples(segment: Segment, monitor: Rows) -> MonitorSamples:
    """What one monitor received from a graph with its own source."""
    stamped = source_times_ns(segment, monitor)
    newest = np.full(monitor.size, NO_MATCH, np.int64) if stamped is None else stamped
    seen = _unasked_samples(segment, monitor, newest)
    return replace(seen, times={**seen.times, "latency": seen.times["age"]})


def _own_pace_samples(segment: Segment, matched: MatchedMonitor) -> MonitorSamples:
    """What one monitor received, while inputs were played, of outputs that answer none."""
    received = matched.rows["received_ns"]
    during = (received >= segment.began_ns) & (received < segment.ended_ns)
    step = matched.matching.step[during]
    newest = np.full(step.size, NO_MATCH, np.int64)
    known = step != NO_MATCH
    newest[known] = matched.steps["published_ns"][step[known]]
    return _unasked_samples(segment, matched.rows[during], newest)


def _unasked_samples(segment: Segment, monitor: Rows, newest: NDArray[np.int64]) -> MonitorSamples:
    """What one monitor received between the ends of a segment, each message as a step.

    Args:
        segment: of the messages.
        monitor: rows of type `MONITOR_DTYPE`.
        newest: see `StepTimes`.
    """
    received: NDArray[np.int64] = monitor["received_ns"]
    arrived = np.sort(received)
    nothing = np.empty(0)
    # Nothing was due: a message is placed at the time of its reception.
    published = np.where(newest == NO_MATCH, received, newest)
    steps = StepTimes(received, published, received, newest)
    return MonitorSamples(
        steps=steps,
        times={
            "latency": nothing,
            "latency_from_due": nothing,
            "age": steps.age,
            "interval": intervals_with_edge_gaps(arrived, segment.began_ns, segment.ended_ns),
            "jitter": jitter(arrived),
        },
        sent=int(arrived.size),
        received=int(arrived.size),
        throughput_hz=throughput(arrived, segment.began_ns, segment.ended_ns - segment.began_ns),
        untimed=_untimed(monitor),
        own_pace=True,
    )


def _untimed(rows: Rows) -> int:
    return int(np.count_nonzero(rows["received_ns"] == rows["taken_ns"]))


SENT_COUNTS = (
    *("sent", "duplicates", "reordered", "unmatched"),
    *("late", "early", "overdue", "surplus"),
)
"""Counts of `MonitorSamples` that depend on what was sent."""

_COUNTS = (*SENT_COUNTS, "received", "untimed")


def pool_monitor(samples: Sequence[MonitorSamples]) -> MonitorSamples:
    """One monitor over several iterations, at least one.

    Times are concatenated, so that each message weighs the same; no interval spans two
    iterations. The throughput is the mean of the iterations' throughputs.
    """
    counts = {name: sum(getattr(sample, name) for sample in samples) for name in _COUNTS}
    return MonitorSamples(
        steps=StepTimes.joined([sample.steps for sample in samples]),
        times={
            family: np.concatenate([sample.times[family] for sample in samples])
            if family not in _FAMILIES_OF_PAIRS
            or not any(sample.unknown_latency for sample in samples)
            else np.empty(0)
            for family in samples[0].times
        },
        throughput_hz=sum(sample.throughput_hz for sample in samples) / len(samples),
        by_order=samples[0].by_order,
        per_step=samples[0].per_step,
        hops=pool_hops([sample.hops for sample in samples]),
        own_pace=samples[0].own_pace,
        pace=tuple(each for sample in samples for each in sample.pace),
        **counts,
    )


def pool_segments(samples: Sequence[SegmentSamples]) -> SegmentSamples:
    """Several iterations as one, at least one; its segment is that of the first."""
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
            name: pool_monitor([sample.monitors[name] for sample in samples])
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
    )


def pool_playback(samples: Sequence[PlaybackSamples]) -> PlaybackSamples:
    """The playback of several iterations, at least one; its rate is the mean of theirs."""
    return PlaybackSamples(
        sent=sum(sample.sent for sample in samples),
        rate_hz=sum(sample.rate_hz for sample in samples) / len(samples),
        lateness=np.concatenate([sample.lateness for sample in samples]),
        planned_hz=sum(sample.planned_hz for sample in samples) / len(samples),
    )
