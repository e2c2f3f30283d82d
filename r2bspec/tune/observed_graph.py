"""What a run with an anatomy says of a graph, whatever way it is deployed."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from r2bspec.judge.measure.anatomy import Anatomy
from r2bspec.judge.measure.anatomy_causes import find_causes
from r2bspec.judge.measure.anatomy_events import NONE, UNKNOWN_NS, Events, Ints, grouped
from r2bspec.judge.measure.host_usage import ProcessSamples
from r2bspec.judge.measure.observed_runs import join_segment
from r2bspec.plan.plan import Plan
from r2bspec.record.run_folder import Run, read_loaded_files
from r2bspec.record.run_record import AnatomyKind, Segment
from r2bspec.tune.processor_time import ProcessorTime, WaitsFor
from r2bspec.tune.queue_model import Callback, Seconds

MIN_STEPS: Final = 50
"""Of an observed rate; fewer say nothing of a p99."""

_JOINED: Final = 0.9
"""A node whose messages so often have a cause on several topics fuses them."""

_UNEXPLAINED: Final = 0.02
"""The share of messages that may have no cause that is known."""

_PROCESSOR_BOUND: Final = 0.8
"""Callbacks that use a processor for a larger part of their time are counted as using it always."""


_SHORTEST_PERIOD_S: Final = 1e-4

_GPU_LIBRARIES: Final = ("libcuda.so", "libcudart.so", "libamdhip64.so")

_MOST_TAKEN: Final = 0.5
"""The share of the time in which the graph needs a processor for which it may wait for one."""


class NotKnownError(Exception):
    """Why the model says nothing of a deployment: a clause."""


@dataclass(frozen=True)
class ObservedInput:
    """What a node does with one topic, or a timer, in one segment.

    Attributes:
        topic: empty for a timer.
        number: tells the timers of a node apart.
        callbacks: in the order of time.
        period_s: of a timer.
    """

    topic: str
    number: int
    callbacks: tuple[Callback, ...]
    period_s: float = 0.0


@dataclass(frozen=True)
class ObservedProcess:
    """The threads of a process, in one segment.

    Attributes:
        nodes: that it calls.
        threads: that call them.
        wake_s: see `r2bspec.tune.queue_model.ExecutorModel`, as the others.
        lead_s: likewise.
        tail_s: likewise.
        idle_s: likewise.
        processor_share: likewise.
    """

    nodes: tuple[str, ...]
    threads: int
    wake_s: Seconds
    lead_s: float
    tail_s: float
    idle_s: float
    processor_share: float


@dataclass(frozen=True)
class ObservedSegment:
    """One iteration of one rate.

    Attributes:
        name: the id of the segment.
        steps: that were played.
        inputs: of the nodes, by name.
        joins: the topics that a node fuses, by its name.
        processes: by name.
        transports: the times from a publication to the arrival, by topic and reader.
        cores: processors that the graph can use at the same time.
        others: processors that others want.
        taken: the share of the time in which the graph needs a processor and waits for one.
    """

    name: str
    rate_hz: float
    steps: int
    inputs: Mapping[str, tuple[ObservedInput, ...]]
    joins: Mapping[str, frozenset[str]]
    processes: Mapping[str, ObservedProcess]
    transports: Mapping[tuple[str, str], Seconds]
    cores: float
    others: float
    taken: float


def observe(
    run: Run, cores: int, waits_for: WaitsFor, joined: dict[str, Anatomy]
) -> tuple[ObservedSegment, ...]:
    """The observed iterations of a run.

    Args:
        run: the run.
        cores: of its machine.
        waits_for: what threads of the graph that waited for a processor are taken to wait for.
        joined: the events of the segments, which the first call joins and later ones find here.

    Raises:
        NotKnownError: they do not say what each node does with a message.
        RecordError: a file of the run is missing or damaged.
    """
    plan = run.plan
    if plan.playback_mode not in {"looping", "sweeping"}:
        raise NotKnownError(f"the graph is not played at a rate ({plan.playback_mode})")
    if plan.called:
        raise NotKnownError("services or actions are called, which the model does not know")
    for process, files in read_loaded_files(run.folder).items():
        if any(library in Path(file).name for file in files for library in _GPU_LIBRARIES):
            raise NotKnownError(f"{process} uses a GPU, which the model does not know")
    records = {record.start: record for record in run.record.anatomies}
    segments = [
        segment
        for segment in run.record.segments
        if segment.kind in {"iteration", "anatomy"}
        and segment.start in records
        and segment.complete
        and segment.steps
        and run.has_anatomy(segment)
    ]
    if not segments:
        raise NotKnownError("the run was not observed from inside: play it with --anatomy")
    samples = ProcessSamples(run.resources())
    found = []
    for segment in segments:
        if (events := joined.get(segment.id)) is None:
            events = joined[segment.id] = join_segment(run, segment, records[segment.start])
        if events.lost:
            raise NotKnownError(f"{events.lost:,} events of the anatomy were lost")
        found.append(_Segment(run, segment, events, samples, cores).observed(waits_for))
    return tuple(found)


def undisturbed(segments: tuple[ObservedSegment, ...]) -> tuple[ObservedSegment, ...]:
    """The segments in which the graph did not wait too long for processors.

    Raises:
        NotKnownError: there is none.
    """
    found = tuple(segment for segment in segments if segment.taken <= _MOST_TAKEN)
    if not found:
        taken = min(segment.taken for segment in segments)
        raise NotKnownError(
            f"the graph waited for a processor {taken * 100:.0f} % of the time that it needed one: "
            "other programs disturbed the run too much"
        )
    return found


class _Segment:
    """The events of one segment, made into what is known of each node."""

    def __init__(
        self, run: Run, segment: Segment, joined: Anatomy, samples: ProcessSamples, cores: int
    ) -> None:
        self._segment = segment
        self._plan: Plan = run.plan
        self._events: Events = joined.events
        self._cores = cores
        record = next(each for each in run.record.anatomies if each.start == segment.start)
        self._processes = tuple(process.name for process in record.processes)
        used = samples.used(segment.began_ns, segment.ended_ns)
        names = {number: process.name for number, process in enumerate(run.record.processes)}
        self._used = {names[number]: use for number, use in used.items() if number in names}
        events = self._events
        harness = events.names.is_harness[events.object]
        began = events.began_ns >= segment.began_ns
        self._starts = np.flatnonzero(
            events.is_start & ~harness & began & (events.callback_ended_ns != UNKNOWN_NS)
        )
        self._sends = np.flatnonzero(events.is_send & ~harness & began)
        self._takes = np.flatnonzero(events.is_take & began & (events.send != NONE))
        self._wall = ProcessorTime(events, self._starts, cores)

    def observed(self, waits_for: WaitsFor) -> ObservedSegment:
        """All of it.

        Raises:
            NotKnownError: a message has no cause that is known.
        """
        if not self._starts.size:
            raise NotKnownError(f"no callback of the graph was observed in {self._segment.id}")
        self._wall.divide(*self._waited(), waits_for)
        self._began = self._wall.work_before(self._events.began_ns)
        self._ended = self._wall.work_before(self._events.callback_ended_ns)
        outputs = self._outputs()
        return ObservedSegment(
            name=self._segment.id,
            rate_hz=self._segment.rate_hz,
            steps=self._segment.steps,
            inputs=self._inputs(outputs),
            joins=dict(self._joins()),
            processes={name: self._threads(name) for name in sorted(self._graph_processes())},
            transports=self._transports(),
            cores=self._wall.cores,
            others=self._wall.others,
            taken=self.taken,
        )

    @property
    def taken(self) -> float:
        """The share of the time in which the graph needs a processor for which it waits for one."""
        used, waited = self._waited()
        return waited / (used + waited) if used + waited > 0 else 0.0

    def _waited(self) -> tuple[float, float]:
        """The processor time of the graph per time, and the time that it waits for that."""
        uses = [use for name, use in self._used.items() if name in self._graph_processes()]
        return sum(use.cpu_mean or 0.0 for use in uses), sum(use.waited or 0.0 for use in uses)

    def _graph_processes(self) -> set[str]:
        numbers = np.unique(self._events.process[self._starts])
        return {self._processes[number] for number in numbers}

    def _wanted_topics(self) -> set[int]:
        """The topics whose messages somebody takes."""
        return set(np.unique(self._events.topic[self._takes]).tolist())

    def _outputs(self) -> dict[int, list[int]]:
        """For each start the messages that it leads to.

        Raises:
            NotKnownError: too many messages have no cause.
        """
        events = self._events
        causes = find_causes(events)
        last = dict(zip(causes.send[causes.last], causes.take[causes.last], strict=True))
        wanted = self._wanted_topics()
        known = set(self._starts.tolist())
        outputs: dict[int, list[int]] = {}
        unexplained: Counter[int] = Counter()
        counts: Counter[int] = Counter()
        for send in self._sends.tolist():
            topic = int(events.topic[send])
            if topic not in wanted:
                continue
            counts[int(events.node[send])] += 1
            within = int(events.within[send])
            owner = within if within != NONE else int(last.get(send, NONE))
            if owner in known:
                outputs.setdefault(owner, []).append(send)
            else:
                unexplained[int(events.node[send])] += 1
        for node, count in unexplained.items():
            if count > max(2, _UNEXPLAINED * counts[node]):
                name = events.names.nodes[node]
                raise NotKnownError(f"{name} publishes messages whose cause is not seen")
        return outputs

    def _inputs(self, outputs: Mapping[int, list[int]]) -> dict[str, tuple[ObservedInput, ...]]:
        events, names = self._events, self._events.names
        found: dict[str, list[ObservedInput]] = {}
        is_timer = events.kind[self._starts] == AnatomyKind.TIMER
        for timers in (False, True):
            rows = self._starts[is_timer == timers]
            keys = events.object[rows] if timers else events.end[rows]
            for number, of_key in grouped(keys, rows).items():
                in_time = of_key[np.argsort(events.began_ns[of_key], kind="stable")]
                period_s = 0.0
                if timers:
                    gaps = np.diff(events.began_ns[in_time])
                    if not gaps.size:
                        continue
                    period_s = float(np.median(gaps)) / 1e9
                node = names.nodes[events.node[of_key[0]]]
                if timers and period_s < _SHORTEST_PERIOD_S:
                    raise NotKnownError(f"a timer of {node} is due too often to be simulated")
                found.setdefault(node, []).append(
                    ObservedInput(
                        topic="" if timers else names.topics[events.topic[of_key[0]]],
                        number=number,
                        callbacks=tuple(self._callback(row, outputs) for row in in_time.tolist()),
                        period_s=period_s,
                    )
                )
        return {node: tuple(inputs) for node, inputs in found.items()}

    def _callback(self, start: int, outputs: Mapping[int, list[int]]) -> Callback:
        events = self._events
        ended = int(events.callback_ended_ns[start])
        began_work, ended_work = float(self._began[start]), float(self._ended[start])
        published = []
        for send in outputs.get(start, ()):
            at = int(events.began_ns[send])
            work = min(float(self._began[send]), ended_work) - began_work
            after_s = work / 1e9 + max(0, at - ended) / 1e9
            published.append((events.names.topics[events.topic[send]], after_s))
        work_s = (ended_work - began_work) / 1e9
        return Callback(work_s, tuple(sorted(published, key=lambda output: output[1])))

    def _joins(self) -> Iterator[tuple[str, frozenset[str]]]:
        """The nodes that fuse messages of several topics."""
        events, names = self._events, self._events.names
        causes = find_causes(events)
        wanted = self._wanted_topics()
        topics: dict[int, set[int]] = {}
        for send, take, by_timer in zip(causes.send, causes.take, causes.by_timer, strict=True):
            if int(events.topic[send]) in wanted and not by_timer:
                topics.setdefault(int(send), set()).add(int(events.topic[take]))
        by_node: dict[int, Counter[frozenset[int]]] = {}
        for send, found in topics.items():
            by_node.setdefault(int(events.node[send]), Counter())[frozenset(found)] += 1
        for node, sets in by_node.items():
            most, count = sets.most_common(1)[0]
            if len(most) > 1 and count >= _JOINED * sets.total():
                yield names.nodes[node], frozenset(names.topics[topic] for topic in most)
            elif any(len(each) > 1 for each in sets):
                raise NotKnownError(
                    f"{names.nodes[node]} publishes sometimes for one input and sometimes for "
                    "several"
                )

    def _threads(self, name: str) -> ObservedProcess:
        """What the threads of a process do between callbacks."""
        events, work_before = self._events, self._wall.work_before
        numbers = [number for number, each in enumerate(self._processes) if each == name]
        own = self._starts[np.isin(events.process[self._starts], numbers)]
        wake: list[Ints] = []
        lead: list[Seconds] = []
        tail: list[Seconds] = []
        idle: list[Seconds] = []
        for of_thread in grouped(events.thread[own], own).values():
            thread = events.thread[of_thread[0]]
            waits = np.flatnonzero((events.thread == thread) & (events.kind == AnatomyKind.WAIT))
            before, after = of_thread[:-1], of_thread[1:]
            first = np.searchsorted(waits, before)
            last = np.searchsorted(waits, after) - 1
            waited = last >= first
            if not waits.size:
                received = events.received_ns[of_thread]
                wake.append((events.began_ns[of_thread] - received)[received != UNKNOWN_NS])
                continue
            first, last = np.minimum(first, waits.size - 1), np.maximum(last, 0)
            lead.append((self._began[after] - self._ended[before])[~waited])
            lead.append((self._began[after] - work_before(events.ended_ns[waits[last]]))[waited])
            tail.append((self._began[waits[first]] - self._ended[before])[waited])
            twice = waited & (last > first)
            second = waits[np.minimum(first + 1, waits.size - 1)]
            idle.append((self._began[second] - self._began[waits[first]])[twice])
            received = events.received_ns[after]
            blocked = waited & (received >= events.began_ns[waits[last]])
            wake.append((events.ended_ns[waits[last]] - received)[blocked])
        wakes = np.maximum(np.concatenate([*wake, np.zeros(0, np.int64)]), 0) / 1e9
        lead_s, tail_s, idle_s = map(_typical, (lead, tail, idle))
        busy_s = self._wall.busy_s(numbers) + own.size * (lead_s + tail_s + idle_s)
        use = self._used.get(name)
        share = 1.0
        if use is not None and use.cpu_mean is not None and busy_s > 0:
            # A thread that waits for a processor needs one.
            needed = use.cpu_mean + (use.waited or 0.0)
            share = min(1.0, needed * self._segment.length_s / busy_s)
        nodes = dict.fromkeys(events.names.nodes[node] for node in events.node[own])
        return ObservedProcess(
            nodes=tuple(nodes),
            threads=int(np.unique(events.thread[own]).size),
            wake_s=wakes if wakes.size else np.zeros(1),
            lead_s=lead_s,
            tail_s=tail_s,
            idle_s=idle_s,
            processor_share=1.0 if share > _PROCESSOR_BOUND else share,
        )

    def _transports(self) -> dict[tuple[str, str], Seconds]:
        events, names = self._events, self._events.names
        sent = events.began_ns[events.send[self._takes]]
        rows = self._takes[sent >= self._segment.began_ns]
        found: dict[tuple[str, str], Seconds] = {}
        for of_object in grouped(events.object[rows], rows).values():
            number = events.object[of_object[0]]
            topic, node = names.topics[names.topic_of[number]], names.nodes[names.node_of[number]]
            received, send = events.received_ns[of_object], events.send[of_object]
            received = np.where(received == UNKNOWN_NS, events.began_ns[of_object], received)
            order = np.argsort(events.began_ns[send], kind="stable")
            took_s = np.maximum(received - events.began_ns[send], 0)[order] / 1e9
            if not names.is_harness[number]:
                found[topic, node] = took_s
                continue
            for monitor in self._plan.monitors:
                if monitor.topic == topic:
                    found.setdefault((topic, monitor.name), took_s)
        return found


def _typical(parts: list[Seconds]) -> float:
    """The mean of durations without the slowest twentieth, in seconds; 0 without any.

    Args:
        parts: in nanoseconds.
    """
    values = np.sort(np.concatenate([*parts, np.zeros(0)]))
    values = values[: max(1, int(0.95 * values.size))]
    return max(0.0, float(values.mean()) / 1e9) if values.size else 0.0
