"""The samples of a run, from its rows: read from a run folder, or kept by a run in progress."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from typing import Any, TypeVar

import msgspec
import numpy as np
from numpy.typing import NDArray

from r2bspec.judge.measure.anatomy_summary import ObservedRows, observed_values, summarised
from r2bspec.judge.measure.host_usage import (
    MACHINE_INDEX,
    ProcessSamples,
    device_use,
    host_interference,
    pool_device_use,
    total_use,
)
from r2bspec.judge.measure.matching import (
    MatchedMonitor,
    Matching,
    live_steps,
    match,
    match_monitor,
    source_times_ns,
)
from r2bspec.judge.measure.metric_catalogue import WHOLE_GRAPH, Subjects
from r2bspec.judge.measure.sample_table import PlayedEarlier, live_samples, monitor_samples
from r2bspec.judge.measure.samples import RunSamples, SegmentSamples, playback_samples
from r2bspec.judge.measure.times import Seconds
from r2bspec.plan.plan import GRAPH_ROLES, MonitorPlan, Plan
from r2bspec.record.comparison_folder import MergedRun, prefixed_id
from r2bspec.record.run_folder import Run
from r2bspec.record.run_record import ProcessRecord, RunRecord, Segment
from r2bspec.record.sample_arrays import DEVICE_DTYPE, Rows

_HARNESS_ROLES = ("player", "monitor", "harness", "observer")


@dataclass(frozen=True)
class SegmentRows:
    """The rows of one segment, as the harness wrote them.

    Attributes:
        playback: rows of type `PLAYBACK_DTYPE`, one per step.
        monitors: rows of type `MONITOR_DTYPE` of each monitor, by name.
        played_earlier: which of some stamps are those of steps of earlier segments; called only
            where messages arrived that match no step of this one.
        anatomy: what was observed from inside; None if nothing was.
        work: see `SegmentSamples`.
    """

    playback: Rows
    monitors: Mapping[str, Rows]
    played_earlier: PlayedEarlier = lambda stamps: np.zeros(stamps.size, np.bool_)
    anatomy: ObservedRows | None = None
    work: Mapping[str, Seconds] = field(default_factory=dict)


@dataclass(frozen=True)
class HostSamples:
    """The samples of processes, host and devices over the whole run.

    Attributes:
        processes: from rows of `RESOURCE_DTYPE`.
        interference: rows of `INTERFERENCE_DTYPE`.
        devices: from rows of `DEVICE_DTYPE`.
    """

    processes: ProcessSamples
    interference: Rows
    devices: ProcessSamples = field(
        default_factory=lambda: ProcessSamples(np.empty(0, DEVICE_DTYPE))
    )


def read_samples(run: Run) -> RunSamples:
    """Read and match the samples of all complete iterations and sustained probes of a run.

    Raises:
        RecordError: a file is missing or damaged.
    """
    played = _PlayedStamps(run)
    return run_samples(
        run.record,
        run.plan,
        lambda segment: segment_samples(run.plan, segment, _read_rows(run, segment, played)),
        HostSamples(
            ProcessSamples(run.resources()), run.interference(), ProcessSamples(run.devices())
        ),
    )


def merged_samples(merged: MergedRun, runs: Sequence[RunSamples]) -> RunSamples:
    """Return the samples of a merged run from those of its parts.

    Args:
        merged: the run.
        runs: the samples of each of its runs.
    """
    segments = {segment.id: segment for segment in merged.record.segments}
    iterations: dict[float, list[SegmentSamples]] = {}
    sustained: dict[float, SegmentSamples] = {}
    reruns: dict[str, SegmentSamples] = {}
    for number, run in enumerate(runs, start=1):

        def of_merged(one: SegmentSamples, number: int = number) -> SegmentSamples:
            return replace(one, segment=segments[prefixed_id(number, one.segment.id)])

        for rate, played in run.iterations.items():
            iterations.setdefault(rate, []).extend(map(of_merged, played))
        sustained |= {rate: of_merged(one) for rate, one in run.sustained.items()}
        reruns |= {prefixed_id(number, name): of_merged(one) for name, one in run.reruns.items()}
    whole = [segment for segment in segments.values() if segment.kind == "iteration"]
    return _run_samples(merged.record, merged.plan, whole, iterations, sustained, reruns)


def _run_samples(
    record: RunRecord,
    plan: Plan,
    segments: Sequence[Segment],
    iterations: Mapping[float, Sequence[SegmentSamples]],
    sustained: Mapping[float, SegmentSamples],
    reruns: Mapping[str, SegmentSamples],
) -> RunSamples:
    """Return the samples of a run, or of a session of it, from those of its segments.

    Args:
        record: the record of the run.
        plan: the plan of the run.
        segments: its iterations, complete or not.
        iterations: see `RunSamples`, as the following.
        sustained: likewise.
        reruns: likewise.
    """
    # The processes are those that ran.
    ran = dict.fromkeys(process.name for process in record.processes)
    return RunSamples(
        record=record,
        peak_hz=record.search.holds_hz if record.search else None,
        monitors=tuple(monitor.name for monitor in plan.monitors),
        iterations={rate: tuple(played) for rate, played in iterations.items()},
        sustained=sustained,
        incomplete=tuple(segment.id for segment in segments if not segment.complete),
        reruns=reruns,
        mode=plan.playback_mode,
        subjects=msgspec.structs.replace(Subjects.of_plan(plan), processes=tuple(ran)),
    )


class _PlayedStamps:
    """When each stamp of a run was played first, read where one is asked for."""

    def __init__(self, run: Run) -> None:
        self._run = run

    @cached_property
    def _first_played(self) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """The stamps in their order, and the begin of the first segment of each."""
        segments = sorted(self._run.record.segments, key=lambda segment: segment.began_ns)
        played = [self._run.playback(segment)["stamp_ns"] for segment in segments]
        began = np.repeat(
            [segment.began_ns for segment in segments], [rows.size for rows in played]
        )
        stamps, first = np.unique(np.concatenate(played), return_index=True)
        return stamps, began[first]

    def before(self, began_ns: int, stamps: NDArray[np.int64]) -> NDArray[np.bool_]:
        """Return which of some stamps were played in segments that began earlier."""
        played, began = self._first_played
        if not played.size:
            return np.zeros(stamps.size, np.bool_)
        place = np.minimum(np.searchsorted(played, stamps), played.size - 1)
        before: NDArray[np.bool_] = (played[place] == stamps) & (began[place] < began_ns)
        return before


def _read_rows(run: Run, segment: Segment, played: _PlayedStamps) -> SegmentRows:
    """Read the rows of one segment from a run folder.

    Raises:
        RecordError: a file of the segment is missing or damaged.
    """
    playback = run.playback(segment)
    processes = [process.name for process in run.record.processes]
    return SegmentRows(
        playback=playback,
        monitors={
            monitor.name: run.monitor(segment, monitor.name) for monitor in run.plan.monitors
        },
        anatomy=_observed_rows(run, segment) if run.plan.anatomy else None,
        work=work_of_steps(run.work(segment), processes, int(playback.size)),
        played_earlier=partial(played.before, segment.began_ns),
    )


def _observed_rows(run: Run, segment: Segment) -> ObservedRows | None:
    """Return what was observed from inside in a segment.

    Raises:
        RecordError: its file is missing or damaged.
    """
    records = run.record.anatomies
    record = next((record for record in records if record.start == segment.start), None)
    return None if record is None else ObservedRows(run.anatomy(segment), record)


def match_segment(run: Run, segment: Segment, monitor: MonitorPlan) -> tuple[Rows, Rows, Matching]:
    """Return the steps of a segment that count for a monitor, its messages, and their matching.

    In a live segment, in which nothing is played, each message is its own step, published when its
    source stamped it; there are none if that time is unknown.

    Raises:
        RecordError: a file of the segment is missing or damaged.
    """
    rows = run.monitor(segment, monitor.name)
    if not segment.live:
        playback, inputs = run.playback(segment), run.plan.step_sources
        matched = match_monitor(playback, rows, monitor, inputs, segment.played_before)
        return matched.steps, rows, matched.matching
    stamped = source_times_ns(segment, rows)
    none = np.empty(0, np.int64)
    steps = live_steps(none, none) if stamped is None else live_steps(rows["stamp_ns"], stamped)
    return steps, rows, match(steps, rows, "order")


def match_monitors(
    plan: Plan, segment: Segment, playback: Rows, received: Mapping[str, Rows]
) -> dict[str, MatchedMonitor]:
    """Return how the outputs of each monitor match the steps of a segment.

    Empty if the graph is live.

    Args:
        plan: the plan of the run.
        segment: one of its segments.
        playback: rows of type `PLAYBACK_DTYPE`: all its steps.
        received: the rows of each monitor, by name.
    """
    if segment.live:
        return {}
    inputs, before = plan.step_sources, segment.played_before
    return {
        monitor.name: match_monitor(playback, received[monitor.name], monitor, inputs, before)
        for monitor in plan.monitors
    }


def segment_samples(
    plan: Plan,
    segment: Segment,
    rows: SegmentRows,
    matched: Mapping[str, MatchedMonitor] | None = None,
) -> SegmentSamples:
    """Return the samples of one segment, without those of processes and of the host.

    Args:
        plan: the plan of the run.
        segment: one of its segments.
        rows: what the harness wrote in it.
        matched: the match of each monitor, where the caller has it already.
    """
    matched = matched or match_monitors(plan, segment, rows.playback, rows.monitors)
    monitors = {}
    for monitor in plan.monitors:
        name = monitor.name
        if segment.live:
            monitors[name] = live_samples(segment, rows.monitors[name])
            continue
        earlier = rows.played_earlier if monitor.match in {"stamp", "any"} else None
        monitors[name] = monitor_samples(segment, matched[name], earlier)
    observed = rows.anatomy
    joined = observed.joined(plan, segment) if observed is not None else None
    return SegmentSamples(
        segment=segment,
        playback=playback_samples(rows.playback),
        monitors=monitors,
        anatomy=observed_values(joined) if joined else {},
        summary=summarised(joined, segment, observed.record, plan) if joined and observed else None,
        processes={},
        machine=None,
        work=rows.work,
    )


def work_of_steps(rows: Rows, processes: Sequence[str], steps: int) -> dict[str, Seconds]:
    """Return the processor time of each step, in seconds, by process and for the whole graph.

    Args:
        rows: of type `WORK_DTYPE`.
        processes: their names, by the index that rows have.
        steps: how many were played; a step without a row has NaN.
    """
    named: dict[str, Seconds] = {}
    for index in np.unique(rows["process"]):
        chosen = rows[(rows["process"] == index) & (rows["step"] < steps)]
        used = np.full(steps, np.nan)
        used[chosen["step"]] = chosen["work_ns"] / 1e9
        name = processes[index]
        named[name] = named[name] + used if name in named else used
    if named:
        named[WHOLE_GRAPH] = np.sum(list(named.values()), axis=0)
    return named


def _of_host(record: RunRecord, plan: Plan, host: HostSamples, segment: Segment) -> dict[str, Any]:
    """Return resource usage and host interference in a segment: fields of `SegmentSamples`."""
    window = segment.began_ns, segment.ended_ns
    used = host.processes.used(*window)
    devices = device_use(host.devices, *window, segment.steps)
    names = {process.name for process in record.processes if process.role in GRAPH_ROLES}
    names |= {process.name for process in plan.processes if process.nodes}
    processes = record.processes
    of_graph = {index for index, process in enumerate(processes) if process.name in names}
    ranks, indices = _ranks(processes), range(len(processes))
    return {
        "processes": _by_name(record, used, ranks, total_use),
        "machine": used.get(MACHINE_INDEX),
        "graph": host.processes.used_together(of_graph, *window),
        "interference": host_interference(host.interference, used, indices, record.machine, window),
        "devices": _by_name(record, devices, ranks, pool_device_use)
        | ({"": devices[MACHINE_INDEX]} if MACHINE_INDEX in devices else {}),
    }


_Use = TypeVar("_Use")


def _by_name(
    record: RunRecord,
    used: Mapping[int, _Use],
    ranks: Mapping[str, int],
    total: Callable[[Sequence[_Use]], _Use],
) -> dict[str, _Use]:
    named: dict[str, list[_Use]] = {}
    for index, use in used.items():
        if 0 <= index < len(record.processes):
            named.setdefault(record.processes[index].name, []).append(use)
    return {name: total(named[name]) for name in sorted(named, key=ranks.__getitem__)}


def _ranks(processes: tuple[ProcessRecord, ...]) -> dict[str, int]:
    """Return the place of each name of a process: those of the harness first.

    The order in which processes are started says nothing: some are started ahead of their turn.
    """
    harness = {role: place for place, role in enumerate(_HARNESS_ROLES)}
    ordered = sorted(processes, key=lambda each: harness.get(each.role, len(harness)))
    return {name: place for place, name in enumerate(dict.fromkeys(each.name for each in ordered))}


def run_samples(
    record: RunRecord,
    plan: Plan,
    samples_of: Callable[[Segment], SegmentSamples],
    host: HostSamples,
) -> RunSamples:
    """Return the samples of all complete iterations and sustained probes of a run.

    Args:
        record: the record of the run so far.
        plan: the plan of the run.
        samples_of: the samples of one complete segment; see `segment_samples`.
        host: what was sampled over the whole run.

    Raises:
        RecordError: `samples_of` reads files, and one is missing or damaged.
    """

    def of_segment(segment: Segment) -> SegmentSamples:
        return replace(samples_of(segment), **_of_host(record, plan, host, segment))

    def session(
        record: RunRecord, iterations: list[Segment], sustained: list[Segment]
    ) -> RunSamples:
        """Return the samples of the complete segments of one session."""
        first_played: dict[float, list[SegmentSamples]] = {}
        reruns: dict[str, SegmentSamples] = {}
        for segment in iterations:
            if segment.complete and segment.rerun_of:
                reruns[segment.rerun_of] = of_segment(segment)
            elif segment.complete:
                first_played.setdefault(segment.rate_hz, []).append(of_segment(segment))
        probed = {probe.rate_hz: of_segment(probe) for probe in sustained if probe.complete}
        return _run_samples(record, plan, iterations, first_played, probed, reruns)

    first = session(
        record,
        [segment for segment in record.segments if segment.kind == "iteration"],
        [segment for segment in record.segments if segment.kind == "sustained"],
    )
    first = replace(
        first,
        turns={
            (segment.kind, plan.play[segment.index - 1].rate_hz): of_segment(segment)
            for segment in record.segments
            if (segment.kind == "turns" or segment.kind == "work_turns") and segment.complete
        },
    )
    fresh = record.confirmation
    if fresh is None:
        return first
    probed = {probe.segment for probe in (fresh.search.probes if fresh.search else ())}
    probed_for = {probe.segment for probe in fresh.sustained}
    again = [segment for segment in record.segments if segment.kind == "confirmation"]
    second = session(
        msgspec.structs.replace(record, search=fresh.search, sustained=fresh.sustained),
        [rerun for rerun in again if rerun.id not in probed | probed_for],
        [rerun for rerun in again if rerun.id in probed_for],
    )
    if second.peak_hz is None:
        # The segments at the peak are then played at the peak of the first session.
        second = replace(second, peak_hz=first.peak_hz)
    return replace(first, confirmation=second)
