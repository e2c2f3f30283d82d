"""Run folders of runs that never happened: latencies, losses and orders are given, not measured."""

from __future__ import annotations

import hashlib
import math
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any, Literal

import msgspec
import numpy as np
from numpy.typing import NDArray

from r2bspec.ipc.arrivals import step_times_ns
from r2bspec.judge.measure.host_usage import HostInterference, ProcessSamples
from r2bspec.judge.measure.matching import MatchedMonitor, Matching
from r2bspec.judge.measure.run_samples import (
    HostSamples,
    SegmentRows,
    run_samples,
    segment_samples,
    work_of_steps,
)
from r2bspec.judge.measure.sample_table import MonitorSamples, monitor_samples
from r2bspec.judge.measure.samples import RunSamples, SegmentSamples
from r2bspec.language.comparison_grammar import parse_requirement
from r2bspec.language.quantities import Duration, Rate
from r2bspec.language.spec import Arrivals, Objective
from r2bspec.plan.canonical_json import canonical_json, plan_hash
from r2bspec.plan.plan import DatasetPlan, MonitorPlan, Plan
from r2bspec.record.run_folder import Run, RunFolder, open_run
from r2bspec.record.run_record import (
    ConfirmationRecord,
    Probe,
    ProcessRecord,
    RunRecord,
    SearchRecord,
    Segment,
    SegmentKind,
)
from r2bspec.record.sample_arrays import (
    DEVICE_DTYPE,
    DEVICE_FIELDS,
    INTERFERENCE_DTYPE,
    MONITOR_DTYPE,
    PLAYBACK_DTYPE,
    RESOURCE_DTYPE,
    WORK_DTYPE,
    Rows,
)

EPOCH_NS = 5_000_000_000_000_000
"""Weeks of uptime: where float64 could no longer tell one nanosecond from the next."""

MONITOR_PLAN = MonitorPlan(name="out", topic="/out", type="", match="stamp", qos=None)
"""A monitor of whose plan nothing matters but that it matches by stamps."""


STAMP_NS = 1_800_000_000_000_000_000


@contextmanager
def edited_record(folder: Path) -> Iterator[dict[str, Any]]:
    """The values of the record of a run, which are written as the block leaves them."""
    file = folder / "record.json"
    record = msgspec.json.decode(file.read_bytes())
    yield record
    file.write_bytes(msgspec.json.encode(record))


def renew_digests(folder: Path) -> None:
    """Let the record of a run be about the samples that are there now."""
    with edited_record(folder) as record:
        record["samples"] = {
            str(file.relative_to(folder)): hashlib.sha256(file.read_bytes()).hexdigest()
            for file in folder.rglob("*.npy")
        }


@dataclass(frozen=True)
class Played:
    """One segment: a latency in seconds for each step (NaN: lost), and what went wrong.

    Attributes:
        late: how late each publication began, in seconds; on time by default.
        twice: steps whose output arrives again, 1 ms later.
        strangers: messages that carry the stamp of no step.
        silent: monitors that received nothing.
        held: how long the monitor had no processor, in seconds.
        arrivals: when the steps came; at equal intervals by default.
    """

    rate_hz: float
    latency: Sequence[float] | NDArray[np.float64]
    late: Sequence[float] | NDArray[np.float64] = ()
    twice: tuple[int, ...] = ()
    strangers: int = 0
    silent: tuple[str, ...] = ()
    kind: SegmentKind = "iteration"
    complete: bool = True
    held: float = 0.0
    arrivals: Arrivals | None = None


@dataclass(frozen=True)
class Simulation:
    """A run to be written; see `RunRecord` for most of the fields.

    `interference` and `devices` say by how much each of their sums grows in a second, `waited` the
    run-queue wait of each process; it is unknown by default. `machine` has further facts of it.
    """

    segments: Sequence[Played] = ()
    objectives: Mapping[str, Objective] = field(default_factory=dict)
    monitors: tuple[str, ...] = ("detections",)
    match: Literal["stamp", "order"] = "stamp"
    search: SearchRecord | None = None
    sustained: tuple[Probe, ...] = ()
    confirmation: ConfirmationRecord | None = None
    status: Literal["complete", "incomplete", "invalid"] = "complete"
    reason: str = ""
    cpu: Mapping[str, float] = field(default_factory=lambda: {"player": 0.1, "apriltag": 0.5})
    start_ns: int = EPOCH_NS
    interference: Mapping[str, float] = field(default_factory=dict)
    devices: Mapping[str, float] = field(default_factory=dict)
    machine: Mapping[str, str] = field(default_factory=dict)
    waited: float = math.nan

    def write(self, path: Path) -> Run:
        """Write the run folder, and open it."""
        folder = RunFolder.create(path)
        plan = self.plan()
        folder.write_plan(canonical_json(plan).decode())
        folder.write_spec("r2bspec: 1\nname: simulated\n")
        played = self._played()
        for segment, rows in played:
            folder.write_rows("playback", rows.playback, segment.id)
            for name, seen in rows.monitors.items():
                folder.write_rows("monitor", seen, segment.id, name)
            folder.write_rows("work", self._work(segment, rows.playback.size), segment.id)
        end_ns = self._end_ns(played)
        folder.write_rows("resources", self._resources(end_ns))
        if self.interference:
            folder.write_rows("interference", self._interference(end_ns))
        if self.devices:
            folder.write_rows("devices", self._devices(end_ns))
        folder.write_record(self._record(plan, tuple(segment for segment, _ in played)))
        return open_run(path)

    def samples(self) -> RunSamples:
        """What is read from the run folder, without one."""
        plan, played = self.plan(), self._played()
        rows = {segment.id: of_segment for segment, of_segment in played}
        end_ns = self._end_ns(played)
        return run_samples(
            self._record(plan, tuple(segment for segment, _ in played)),
            plan,
            lambda segment: segment_samples(plan, segment, rows[segment.id]),
            HostSamples(
                ProcessSamples(self._resources(end_ns)),
                self._interference(end_ns)
                if self.interference
                else np.empty(0, INTERFERENCE_DTYPE),
                ProcessSamples(self._devices(end_ns)),
            ),
        )

    def _played(self) -> list[tuple[Segment, SegmentRows]]:
        """The segments, one after the other on one clock, and what was recorded of each."""
        found: list[tuple[Segment, SegmentRows]] = []
        counts: Counter[str] = Counter()
        for played in self.segments:
            counts[played.kind] += 1
            start_ns = self._end_ns(found)
            segment = msgspec.structs.replace(
                segment_of(played.rate_hz, len(played.latency), start_ns),
                id=f"{played.kind}-{len(found) + 1:03d}",
                kind=played.kind,
                index=counts[played.kind],
                complete=played.complete,
                monitor_held_ns=round(played.held * 1e9),
                arrivals=played.arrivals.kind if played.arrivals else msgspec.UNSET,
            )
            playback = playback_rows(played, start_ns)
            rows = monitor_rows(played, playback)
            monitors = {name: rows[:0] if name in played.silent else rows for name in self.monitors}
            earlier = [np.empty(0, np.int64), *(rows.playback["stamp_ns"] for _, rows in found)]
            played_earlier = partial(np.isin, test_elements=np.concatenate(earlier))
            work = work_of_steps(self._work(segment, playback.size), [*self.cpu], playback.size)
            found.append(
                (
                    segment,
                    SegmentRows(playback, monitors, played_earlier=played_earlier, work=work),
                )
            )
        return found

    def _work(self, segment: Segment, steps: int) -> Rows:
        """The processor time of all steps but the last one."""
        rows = np.zeros((len(self.cpu), max(0, steps - 1)), WORK_DTYPE)
        rows["step"] = np.arange(rows.shape[1])
        rows["process"] = np.arange(len(self.cpu))[:, np.newaxis]
        if segment.rate_hz:
            share = np.array([*self.cpu.values()])[:, np.newaxis]
            rows["work_ns"] = share / segment.rate_hz * 1e9
        return rows.ravel()

    def _end_ns(self, played: Sequence[tuple[Segment, SegmentRows]]) -> int:
        return played[-1][0].ended_ns + 500_000_000 if played else self.start_ns

    def plan(self) -> Plan:
        """The plan of the run, as far as measuring and judging read it."""
        return Plan(
            generator="r2bspec 0",
            name="simulated",
            title="A simulated run",
            description="",
            labels={},
            namespace="r2b",
            environment=(),
            transport="shared_memory",
            largest_message_bytes=100,
            dataset=DatasetPlan(
                source="r2b_storage",
                kind="synthetic",
                sha256="0" * 64,
                start_ns=0,
                end_ns=None,
                topics=(),
            ),
            processes=(),
            topics=(),
            playback_mode="looping",
            buffer=0,
            inputs=(),
            monitors=tuple(monitor_plan(name, self.match) for name in self.monitors),
            phases=("load", "start", "play", "collect"),
            warm_up=Duration(10**9),
            start_timeout=Duration(10**9),
            search=None,
            sustained_hz=(),
            play=(),
            objectives=dict(self.objectives),
        )

    def _record(self, plan: Plan, segments: tuple[Segment, ...]) -> RunRecord:
        return RunRecord(
            run_id="0123456789abcdef",
            plan_hash=plan_hash(plan),
            started_at="2026-01-01T00:00:00+00:00",
            ended_at="2026-01-01T00:01:00+00:00",
            status=self.status,
            reason=self.reason,
            dataset={"source": "r2b_storage", "sha256": "0" * 64},
            machine={"cpu": "a simulated processor", "cores": 2, **self.machine},
            versions={"r2bspec": "0.0.0"},
            processes=tuple(
                ProcessRecord(
                    name=name,
                    role="player" if name == "player" else "host",
                    pid=number + 100,
                    exit_code=0,
                )
                for number, name in enumerate(self.cpu)
            ),
            segments=segments,
            search=self.search,
            sustained=self.sustained,
            events=((self.start_ns, "start"),),
            confirmation=self.confirmation,
        )

    def _interference(self, end_ns: int) -> Rows:
        times = _times(self.start_ns, end_ns)
        rows = np.zeros(times.size, INTERFERENCE_DTYPE)
        rows["time_ns"] = times
        rows["cycles"] = math.nan
        for name, growth in self.interference.items():
            rows[name] = 100 + growth * ((times - times[0]) / 1e9)
        return rows

    def _devices(self, end_ns: int) -> Rows:
        """The machine, and the second process of the run, which does a half of what it does."""
        times = _times(self.start_ns, end_ns) if self.devices else np.empty(0, np.int64)
        rows = np.zeros((2, times.size), DEVICE_DTYPE)
        rows["time_ns"], rows["process"] = times, [[-1], [1]]
        for name, _ in DEVICE_FIELDS[2:]:
            growth = self.devices.get(name, math.nan)
            rows[name] = growth if name == "gpu_bytes" else growth * (times - times[:1]) / 1e9
            rows[name][1] /= 2
        return rows.ravel()

    def _resources(self, end_ns: int) -> Rows:
        times = _times(self.start_ns, end_ns)
        loads = [(-1, sum(self.cpu.values()) + 0.05), *enumerate(self.cpu.values())]
        rows = np.zeros(times.size * len(loads), RESOURCE_DTYPE)
        rows["time_ns"] = np.repeat(times, len(loads))
        rows["process"] = np.tile([number for number, _ in loads], times.size)
        rows["cpu_s"] = np.tile([load for _, load in loads], times.size) * (
            (rows["time_ns"] - times[0]) / 1e9
        )
        rows["waited_s"] = self.waited * ((rows["time_ns"] - times[0]) / 1e9)
        rows["memory_bytes"] = (np.tile(range(len(loads)), times.size) + 1) * 50 * 2**20
        return rows


def segment_of(
    rate_hz: float, steps: int, start_ns: int = EPOCH_NS, *, length_ns: int | None = None
) -> Segment:
    """A first iteration of so many steps."""
    return Segment(
        id="iteration-001",
        kind="iteration",
        rate_hz=rate_hz,
        index=1,
        steps=steps,
        began_ns=start_ns,
        ended_ns=start_ns + (round(steps * 1e9 / rate_hz) if length_ns is None else length_ns),
        complete=True,
    )


def samples_of(
    playback: Rows, received: Rows, matching: Matching, segment: Segment | None = None
) -> MonitorSamples:
    """What a monitor received, by how it matches what was played."""
    played = segment or segment_of(10.0, int(playback.size))
    return monitor_samples(played, MatchedMonitor(playback, received, matching))


def monitor_plan(name: str, match: Literal["stamp", "order"] = "stamp") -> MonitorPlan:
    """A monitor of messages with a header."""
    return MonitorPlan(
        name=name, topic=f"/r2b/{name}", type="std_msgs/msg/Header", match=match, qos=None
    )


def _times(start_ns: int, end_ns: int) -> NDArray[np.int64]:
    return np.arange(start_ns - 10**9, end_ns + 10**9, 200_000_000, dtype=np.int64)


def playback_rows(played: Played, start_ns: int = EPOCH_NS) -> Rows:
    """What the player would have written."""
    steps = np.arange(len(played.latency))
    rows = np.zeros(steps.size, PLAYBACK_DTYPE)
    rows["due_ns"] = start_ns + np.round(steps * 1e9 / played.rate_hz).astype(np.int64)
    if played.arrivals is not None:
        arrivals, rate_hz = played.arrivals, played.rate_hz
        rows["due_ns"] = start_ns + step_times_ns(arrivals, rate_hz, steps.size, "simulated")
    late = np.asarray(played.late if len(played.late) else np.zeros(steps.size))
    rows["published_ns"] = rows["due_ns"] + np.round(late * 1e9).astype(np.int64)
    rows["done_ns"] = rows["published_ns"] + 10_000
    rows["stamp_ns"] = STAMP_NS + (rows["published_ns"] - EPOCH_NS)
    return rows


def monitor_rows(played: Played, playback: Rows) -> Rows:
    """What a monitor would have written, in the order of arrival."""
    latency = np.asarray(played.latency, dtype=np.float64)
    arrived = np.flatnonzero(~np.isnan(latency))
    steps = np.concatenate((arrived, np.asarray(played.twice, dtype=np.int64)))
    extra = np.concatenate((np.zeros(arrived.size), np.full(len(played.twice), 0.001)))
    rows = np.zeros(steps.size + played.strangers, MONITOR_DTYPE)
    rows["stamp_ns"][: steps.size] = playback["stamp_ns"][steps]
    rows["received_ns"][: steps.size] = playback["published_ns"][steps] + np.round(
        (latency[steps] + extra) * 1e9
    ).astype(np.int64)
    rows["stamp_ns"][steps.size :] = 7
    rows["received_ns"][steps.size :] = playback["published_ns"][0] if playback.size else 0
    rows["taken_ns"] = rows["received_ns"] + 50_000
    rows["bytes"] = 100
    return rows[np.argsort(rows["received_ns"], kind="stable")]


def objective(*requirements: str, at: str = "30 Hz") -> Objective:
    """An objective from texts; `at` empty for the search as a whole."""
    return Objective(
        at=Rate.parse(at) if at else None,
        require=tuple(parse_requirement(text) for text in requirements),
    )


def bracket(record: SearchRecord) -> tuple[float, float]:
    """The rate that a search has found to hold, and the one that fails."""
    assert record.holds_hz is not None
    assert record.fails_hz is not None
    return record.holds_hz, record.fails_hz


def probe(rate_hz: float, *, holds: bool, reason: str = "delivered as offered") -> Probe:
    """One probe of a search."""
    return Probe(
        segment="probe-001",
        rate_hz=rate_hz,
        delivered_hz=rate_hz if holds else rate_hz * 0.8,
        holds=holds,
        reason=reason,
    )


def with_starts(samples: RunSamples, starts: Sequence[int]) -> RunSamples:
    """The run with its iterations in these starts."""
    return _with_iterations(
        samples,
        lambda place, one: replace(
            one, segment=msgspec.structs.replace(one.segment, start=starts[place])
        ),
    )


def with_interference(samples: RunSamples, *around: HostInterference | None) -> RunSamples:
    """The run with this host interference during its iterations; the last one lasts."""
    return _with_iterations(
        samples, lambda place, one: replace(one, interference=around[min(place, len(around) - 1)])
    )


def _with_iterations(
    samples: RunSamples, change: Callable[[int, SegmentSamples], SegmentSamples]
) -> RunSamples:
    changed = {
        rate: tuple(change(place, one) for place, one in enumerate(played))
        for rate, played in samples.iterations.items()
    }
    return replace(samples, iterations=changed)
