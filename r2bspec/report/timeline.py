"""The timeline of a run, and the formats with a time axis: phases, messages and loads.

The Trace Event Format is what Perfetto and chrome://tracing open. Phases and segments are slices,
messages in flight are asynchronous slices of each monitor, from publication to reception, and CPU
and memory are counters. An iteration that was observed from inside has a track for each thread of
the graph. A lost message is a slice named ``lost`` that ends with its segment. Times
are microseconds since the first event.

An MCAP file has the metrics over time, for Foxglove. Topics: ``/r2bspec/MONITOR/latency`` with a
message for each step, ``/r2bspec/MONITOR/missed`` with one for each missed output,
``/r2bspec/MONITOR/metrics`` at the end of each iteration, ``/r2bspec/load/PROCESS`` and
``/r2bspec/phase``. Messages are JSON with a schema; their times are those of the system clock,
converted from the monotonic one by the stamps of the playback. ``result.json`` is attached. The
messages of the graph itself are not recorded in a run.

All other times are CLOCK_MONOTONIC nanoseconds, as in the run folder.
"""

from __future__ import annotations

import io
import json
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any, Final

import msgspec
import numpy as np

from r2bspec.compare.report_input import ReportInput
from r2bspec.judge.judge_run import to_json
from r2bspec.judge.measure.anatomy_events import NONE, UNKNOWN_NS, Events
from r2bspec.judge.measure.host_usage import MACHINE_INDEX, ProcessSamples, spaced_indices
from r2bspec.judge.measure.metrics import pace_of
from r2bspec.judge.measure.observed_runs import join_segment, last_run, observed_segments
from r2bspec.judge.measure.run_samples import match_segment
from r2bspec.judge.measure.units import show_rate
from r2bspec.plan.plan import MonitorPlan
from r2bspec.record.run_folder import Run
from r2bspec.record.run_record import AnatomyKind, AnatomyRecord, Segment

WHOLE_MACHINE = "whole machine"


@dataclass(frozen=True, slots=True)
class ExpectedAnswer:
    """An expected output at one monitor; `received_ns` is None if it never arrived."""

    segment: Segment
    step: int
    published_ns: int
    received_ns: int | None

    @property
    def latency_ns(self) -> int | None:
        """From publication to reception."""
        return None if self.received_ns is None else self.received_ns - self.published_ns


@dataclass(frozen=True, slots=True)
class LoadSample:
    """The load of a process since the sample before; one core is 1."""

    process: str
    at_ns: int
    cpu: float
    memory_bytes: int


def phases(run: Run, end_ns: int | None = None) -> list[tuple[str, int, int]]:
    """Each phase with its beginning and its end.

    The last one ends at `end_ns`, or, where that is None, with the last segment.
    """
    begun = [
        (text.removeprefix("phase "), at_ns)
        for at_ns, text in run.record.events
        if text.startswith("phase ")
    ]
    if end_ns is None:
        ends = [segment.ended_ns for segment in run.record.segments]
        end_ns = max([*ends, *(at_ns for at_ns, _ in run.record.events)], default=0)
    # Without any recorded phase, the last end is left over.
    ends = [*(at_ns for _, at_ns in begun[1:]), end_ns]
    return [(name, at_ns, max(end, at_ns)) for (name, at_ns), end in zip(begun, ends, strict=False)]


def expected_answers(run: Run, monitor: MonitorPlan) -> Iterator[ExpectedAnswer]:
    """Every expected output, in the order of playing, of the segments where pairs are known."""
    for segment in run.record.segments:
        playback, rows, matched = match_segment(run, segment, monitor)
        if not matched.pairs_known:
            continue
        for step, row in zip(
            matched.trigger_steps.tolist(), matched.first_row.tolist(), strict=True
        ):
            yield ExpectedAnswer(
                segment=segment,
                step=step,
                published_ns=int(playback["published_ns"][step]),
                received_ns=int(rows["received_ns"][row]) if row >= 0 else None,
            )


def load_samples(run: Run) -> Iterator[LoadSample]:
    """Every sample except the first of each process, by process."""
    samples = ProcessSamples(run.resources())
    names = {number: process.name for number, process in enumerate(run.record.processes)}
    for index, name in {**names, MACHINE_INDEX: WHOLE_MACHINE}.items():
        of_one = samples.rows(index)
        of_one = of_one[spaced_indices(of_one["time_ns"])]
        spans = np.diff(of_one["time_ns"])
        used = np.diff(of_one["cpu_s"])
        for at, (span, cpu_s) in enumerate(zip(spans.tolist(), used.tolist(), strict=True), 1):
            if span > 0:
                yield LoadSample(
                    process=name,
                    at_ns=int(of_one["time_ns"][at]),
                    cpu=cpu_s / (span / 1e9),
                    memory_bytes=int(of_one["memory_bytes"][at]),
                )


_RUN, _LOADS, _MESSAGES = 1, 2, 3
"""Groups of tracks; the format calls them processes."""


def render_trace(report_input: ReportInput) -> bytes:
    """The JSON object; one event a line.

    Raises:
        ReportError: only the result is known.
    """
    run = report_input.require_run("the format trace")
    lines = ",\n".join(json.dumps(event, separators=(",", ":")) for event in _events(run))
    about = {
        "benchmark": report_input.result.name,
        "run_id": report_input.result.run_id,
        "verdict": report_input.result.verdict.outcome,
    }
    head = f'{{"displayTimeUnit":"ms","otherData":{json.dumps(about)},"traceEvents":[\n'
    return f"{head}{lines}\n]}}\n".encode()


def _events(run: Run) -> Iterator[dict[str, Any]]:
    zero, pace = _first_ns(run), pace_of(run.plan.playback_mode)

    def at(time_ns: int) -> float:
        return round((time_ns - zero) / 1e3, 3)

    yield _named("process_name", _RUN, 0, "run")
    yield _named("process_name", _LOADS, 0, "load")
    yield _named("thread_name", _RUN, 1, "phases")
    yield _named("thread_name", _RUN, 2, "segments")
    for name, began, ended in phases(run):
        yield _slice(name, "phase", at, began, ended, {"pid": _RUN, "tid": 1})
    for segment in run.record.segments:
        name, place = f"{segment.kind} {show_rate(segment.rate_hz, pace)}", {"pid": _RUN, "tid": 2}
        args = {"id": segment.id, "rate_hz": segment.rate_hz, "complete": segment.complete}
        played = _slice(name, "segment", at, segment.began_ns, segment.ended_ns, place)
        yield {**played, "args": args}
    for number, monitor in enumerate(run.plan.monitors):
        pid = _MESSAGES + number
        yield _named("process_name", pid, 0, f"in flight: {monitor.name}")
        for count, answer in enumerate(expected_answers(run, monitor)):
            ended = answer.segment.ended_ns if answer.received_ns is None else answer.received_ns
            shared = {"cat": "message", "id": f"{number}.{count}", "pid": pid, "tid": 0}
            name = "lost" if answer.received_ns is None else "message"
            args = {"segment": answer.segment.id, "step": answer.step}
            yield {
                "ph": "b", "name": name, "ts": at(answer.published_ns), "args": args, **shared
            }  # fmt: skip
            yield {"ph": "e", "name": name, "ts": at(max(ended, answer.published_ns)), **shared}
    for load in load_samples(run):
        values = {"CPU %": round(load.cpu * 100, 2)}
        yield _counter(f"CPU {load.process}", at(load.at_ns), values)
        values = {"MiB": round(load.memory_bytes / 2**20, 2)}
        yield _counter(f"memory {load.process}", at(load.at_ns), values)
    yield from observed_events(run, at)


def _named(what: str, pid: int, tid: int, name: str) -> dict[str, Any]:
    return {"ph": "M", "name": what, "pid": pid, "tid": tid, "args": {"name": name}}


def _counter(name: str, at: float, values: dict[str, float]) -> dict[str, Any]:
    return {"ph": "C", "pid": _LOADS, "tid": 0, "name": name, "ts": at, "args": values}


def _first_ns(run: Run) -> int:
    rows = run.resources()
    times = [at_ns for at_ns, _ in run.record.events]
    times += [segment.began_ns for segment in run.record.segments]
    times += [int(rows["time_ns"].min())] if rows.size else []
    return min(times, default=0)


_NUMBER = {"type": "number"}

_SCHEMAS: dict[str, dict[str, Any]] = {
    "latency": {"latency_ms": _NUMBER, "offered_hz": _NUMBER, "step": {"type": "integer"}},
    "missed": {"offered_hz": _NUMBER, "step": {"type": "integer"}, "segment": {"type": "string"}},
    "metrics": {
        "offered_hz": _NUMBER,
        "segment": {"type": "string"},
        "metrics": {"type": "object"},
    },
    "load": {"cpu_percent": _NUMBER, "memory_mib": _NUMBER},
    "phase": {"phase": {"type": "string"}},
}

_Stream = Iterator[tuple[int, str, str, dict[str, Any]]]
"""Time, schema, topic and content of messages."""


def render_mcap(report_input: ReportInput) -> bytes:
    """The file, its messages in the order of time.

    Raises:
        ReportError: only the result is known.
    """
    from mcap.writer import CompressionType, Writer

    run = report_input.require_run("the format mcap")
    offset = _clock_offset_ns(run)
    buffer = io.BytesIO()
    writer = Writer(buffer, compression=CompressionType.ZSTD)
    writer.start(profile="", library="r2bspec")
    schemas = {
        name: writer.register_schema(
            name=f"r2bspec/{name}",
            encoding="jsonschema",
            data=json.dumps({"type": "object", "properties": properties}).encode(),
        )
        for name, properties in _SCHEMAS.items()
    }
    channels: dict[str, int] = {}
    messages = [
        (at_ns, number, schema, topic, content)
        for stream in _streams(report_input, run)
        for number, (at_ns, schema, topic, content) in enumerate(stream)
    ]
    for at_ns, number, schema, topic, content in sorted(messages, key=lambda message: message[:4]):
        if topic not in channels:
            channels[topic] = writer.register_channel(
                topic=topic, message_encoding="json", schema_id=schemas[schema]
            )
        time_ns = max(at_ns + offset, 0)
        writer.add_message(
            channel_id=channels[topic],
            log_time=time_ns,
            publish_time=time_ns,
            sequence=number,
            data=json.dumps(content, separators=(",", ":")).encode(),
        )
    result = report_input.result
    facts = {"name": result.name, "run_id": result.run_id, "verdict": result.verdict.outcome}
    writer.add_metadata("r2bspec", facts)
    writer.add_attachment(
        create_time=0,
        log_time=0,
        name="result.json",
        media_type="application/json",
        data=to_json(result),
    )
    writer.finish()  # type: ignore[no-untyped-call]
    return buffer.getvalue()


def _clock_offset_ns(run: Run) -> int:
    """System clock minus monotonic clock, from the stamps of what was published."""
    for segment in run.record.segments:
        rows = run.playback(segment)
        if rows.size:
            return int(np.median(rows["stamp_ns"] - rows["published_ns"]))
        if segment.clock_offset_ns is not None:
            return segment.clock_offset_ns
    return 0


def _streams(report_input: ReportInput, run: Run) -> Iterator[_Stream]:
    yield ((began, "phase", "/r2bspec/phase", {"phase": name}) for name, began, _ in phases(run))
    for monitor in run.plan.monitors:
        yield _of_messages(run, monitor)
        yield _of_metrics(report_input, run, monitor.name)
    yield (
        (
            load.at_ns,
            "load",
            f"/r2bspec/load/{load.process.replace(' ', '_')}",
            {"cpu_percent": load.cpu * 100, "memory_mib": load.memory_bytes / 2**20},
        )
        for load in load_samples(run)
    )


def _of_messages(run: Run, monitor: MonitorPlan) -> _Stream:
    for answer in expected_answers(run, monitor):
        facts = {"offered_hz": answer.segment.rate_hz, "step": answer.step}
        if answer.received_ns is None or answer.latency_ns is None:
            missed = {**facts, "segment": answer.segment.id}
            yield answer.published_ns, "missed", f"/r2bspec/{monitor.name}/missed", missed
        else:
            received = {"latency_ms": answer.latency_ns / 1e6, **facts}
            yield answer.received_ns, "latency", f"/r2bspec/{monitor.name}/latency", received


def _of_metrics(report_input: ReportInput, run: Run, monitor: str) -> _Stream:
    ended = {segment.id: segment.ended_ns for segment in run.record.segments}
    for rate in report_input.result.metrics.rates:
        for iteration in rate.iterations:
            content = {
                "offered_hz": rate.offered_hz,
                "segment": iteration.segment,
                "metrics": msgspec.to_builtins(iteration.monitors[monitor]),
            }
            yield ended[iteration.segment], "metrics", f"/r2bspec/{monitor}/metrics", content


MAX_ROWS: Final = 100_000
"""Events of an iteration that are drawn, from its beginning on: about 30 MB of text."""

_FIRST_GROUP: Final = 1000
"""The number of the first group: those before are of the run, and of its monitors."""

_WORDS: Final = {
    AnatomyKind.PUBLISH: "publish",
    AnatomyKind.TAKE: "take",
    AnatomyKind.DEQUEUE: "take",
    AnatomyKind.SEND_REQUEST: "request",
    AnatomyKind.TAKE_REQUEST: "take request",
    AnatomyKind.SEND_RESPONSE: "respond",
    AnatomyKind.TAKE_RESPONSE: "take response",
}

_At = Callable[[int], float]


def observed_events(run: Run, at: _At) -> Iterator[dict[str, Any]]:
    """The events of all iterations that reports show the anatomy of.

    Args:
        run: the run.
        at: converts CLOCK_MONOTONIC nanoseconds to the microseconds of the trace.

    Raises:
        RecordError: a file of the run is missing or damaged.
    """
    group = _FIRST_GROUP
    run = last_run(run)
    for segment, record in observed_segments(run):
        events = join_segment(run, segment, record).events
        yield from _groups(events, record, segment.id, group)
        yield from _slices(events, at, group)
        group += len(record.processes)


def _groups(
    events: Events, record: AnatomyRecord, segment: str, group: int
) -> Iterator[dict[str, Any]]:
    for number, process in enumerate(record.processes):
        yield _named("process_name", group + number, 0, f"{process.name} ({segment})")
    threads, rows = np.unique(events.thread, return_index=True)
    for thread, row in zip(threads.tolist(), rows.tolist(), strict=True):
        pid = group + int(events.process[row])
        yield _named("thread_name", pid, thread + 1, f"thread {thread + 1}")


def _slices(events: Events, at: _At, group: int) -> Iterator[dict[str, Any]]:
    acts = np.flatnonzero(events.is_take | events.is_send | events.is_start)
    acts = acts[np.argsort(events.began_ns[acts], kind="stable")][:MAX_ROWS]
    names, node, topic = events.names, events.node, events.topic
    for row in acts.tolist():
        place = {"pid": group + int(events.process[row]), "tid": int(events.thread[row]) + 1}
        began, ended = int(events.began_ns[row]), int(events.ended_ns[row])
        about = names.topics[topic[row]]
        owner = names.nodes[node[row]]
        kind = AnatomyKind(int(events.kind[row]))
        if kind in _WORDS:
            yield _slice(f"{_WORDS[kind]} {about}", kind.name.lower(), at, began, ended, place)
        if events.is_start[row] and events.callback_began_ns[row] != UNKNOWN_NS:
            began, ended = int(events.callback_began_ns[row]), int(events.callback_ended_ns[row])
            if ended >= began:
                name = f"{owner}: {about or 'timer'}"
                yield _slice(name, "callback", at, began, ended, place)
        send = int(events.send[row])
        if send != NONE:
            shared = {"cat": "message", "name": about, "id": f"anatomy.{group}.{row}"}
            sender = {
                "pid": group + int(events.process[send]),
                "tid": int(events.thread[send]) + 1,
            }
            yield {"ph": "s", "ts": at(int(events.began_ns[send])), **sender, **shared}
            yield {"ph": "f", "bp": "e", "ts": at(int(events.began_ns[row])), **place, **shared}


def _slice(
    name: str, category: str, at: _At, began: int, ended: int, place: dict[str, int]
) -> dict[str, Any]:
    duration = round((ended - began) / 1e3, 3)
    return {"ph": "X", "name": name, "cat": category, "ts": at(began), "dur": duration, **place}
