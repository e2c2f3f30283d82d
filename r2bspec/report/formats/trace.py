"""A timeline in the Trace Event Format, which Perfetto and chrome://tracing open.

Phases and segments are slices, messages in flight are asynchronous slices of each monitor, from
publication to reception, and CPU and memory are counters. A lost message is a slice named ``lost``
that ends with its segment. Times are microseconds since the first event.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from typing import Any

from r2bspec.compare.report_input import ReportInput
from r2bspec.measure.metrics import pace_of
from r2bspec.measure.units import show_rate
from r2bspec.record.run_folder import Run
from r2bspec.report.trace_timeline import expected_answers, load_samples, phases

_RUN, _LOADS, _MESSAGES = 1, 2, 3
"""Groups of tracks; the format calls them processes."""


def render(report_input: ReportInput) -> bytes:
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
        yield {
            "ph": "X", "pid": _RUN, "tid": 1, "name": name, "cat": "phase",
            "ts": at(began), "dur": round((ended - began) / 1e3, 3),
        }  # fmt: skip
    for each in run.record.segments:
        yield {
            "ph": "X", "pid": _RUN, "tid": 2,
            "name": f"{each.kind} {show_rate(each.rate_hz, pace)}",
            "cat": "segment", "ts": at(each.began_ns),
            "dur": round((each.ended_ns - each.began_ns) / 1e3, 3),
            "args": {"id": each.id, "rate_hz": each.rate_hz, "complete": each.complete},
        }  # fmt: skip
    for number, monitor in enumerate(run.plan.monitors):
        pid = _MESSAGES + number
        yield _named("process_name", pid, 0, f"in flight: {monitor.name}")
        for count, one in enumerate(expected_answers(run, monitor.name)):
            lost = one.received_ns is None
            ended = one.segment.ended_ns if one.received_ns is None else one.received_ns
            shared = {"cat": "message", "id": f"{number}.{count}", "pid": pid, "tid": 0}
            name = "lost" if lost else "message"
            args = {"segment": one.segment.id, "step": one.step}
            yield {
                "ph": "b", "name": name, "ts": at(one.published_ns), "args": args, **shared
            }  # fmt: skip
            yield {"ph": "e", "name": name, "ts": at(max(ended, one.published_ns)), **shared}
    for load in load_samples(run):
        values = {"CPU %": round(load.cpu * 100, 2)}
        yield _counter(f"CPU {load.process}", at(load.at_ns), values)
        values = {"MiB": round(load.memory_bytes / 2**20, 2)}
        yield _counter(f"memory {load.process}", at(load.at_ns), values)


def _named(what: str, pid: int, tid: int, name: str) -> dict[str, Any]:
    return {"ph": "M", "name": what, "pid": pid, "tid": tid, "args": {"name": name}}


def _counter(name: str, at: float, values: dict[str, float]) -> dict[str, Any]:
    return {"ph": "C", "pid": _LOADS, "tid": 0, "name": name, "ts": at, "args": values}


def _first_ns(run: Run) -> int:
    rows = run.resources()
    times = [at_ns for at_ns, _ in run.record.events]
    times += [each.began_ns for each in run.record.segments]
    times += [int(rows["time_ns"].min())] if rows.size else []
    return min(times, default=0)
