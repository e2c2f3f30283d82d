"""An MCAP file with the metrics over time, for Foxglove.

Topics: ``/r2bspec/MONITOR/latency`` with a message for each step, ``/r2bspec/MONITOR/missed`` with
one for each missed output, ``/r2bspec/MONITOR/metrics`` at the end of each iteration,
``/r2bspec/load/PROCESS`` and ``/r2bspec/phase``. Messages are JSON with a schema; their times are
those of the system clock, converted from the monotonic one by the stamps of the playback.
``result.json`` is attached. The messages of the graph itself are not recorded in a run.
"""

from __future__ import annotations

import heapq
import io
import json
from collections.abc import Iterator
from typing import Any

import msgspec
import numpy as np

from r2bspec.compare.report_input import ReportInput
from r2bspec.judge.judge_run import to_json
from r2bspec.record.run_folder import Run
from r2bspec.report.trace_timeline import expected_answers, load_samples, phases

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

_Timed = tuple[int, int, str, str, dict[str, Any]]
"""Time, a number that keeps the order stable, schema, topic, content."""


def render(report_input: ReportInput) -> bytes:
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
    for at_ns, number, schema, topic, content in heapq.merge(*_sorted(report_input, run)):
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


def _sorted(report_input: ReportInput, run: Run) -> list[list[_Timed]]:
    return [
        sorted((at_ns, number, *rest) for number, (at_ns, *rest) in enumerate(found))  # type: ignore[misc]
        for found in _streams(report_input, run)
    ]


def _streams(
    report_input: ReportInput, run: Run
) -> Iterator[Iterator[tuple[int, str, str, dict[str, Any]]]]:
    yield ((began, "phase", "/r2bspec/phase", {"phase": name}) for name, began, _ in phases(run))
    for monitor in run.plan.monitors:
        yield _of_messages(run, monitor.name)
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


def _of_messages(run: Run, monitor: str) -> Iterator[tuple[int, str, str, dict[str, Any]]]:
    for one in expected_answers(run, monitor):
        rate = one.segment.rate_hz
        if one.received_ns is None:
            content: dict[str, Any] = {"offered_hz": rate, "step": one.step}
            content["segment"] = one.segment.id
            yield one.published_ns, "missed", f"/r2bspec/{monitor}/missed", content
        else:
            latency = (one.received_ns - one.published_ns) / 1e6
            content = {"latency_ms": latency, "offered_hz": rate, "step": one.step}
            yield one.received_ns, "latency", f"/r2bspec/{monitor}/latency", content


def _of_metrics(
    report_input: ReportInput, run: Run, monitor: str
) -> Iterator[tuple[int, str, str, dict[str, Any]]]:
    ended = {each.id: each.ended_ns for each in run.record.segments}
    for rate in report_input.result.metrics.rates:
        for one in rate.iterations:
            content = {
                "offered_hz": rate.offered_hz,
                "segment": one.segment,
                "metrics": msgspec.to_builtins(one.monitors[monitor]),
            }
            yield ended[one.segment], "metrics", f"/r2bspec/{monitor}/metrics", content
