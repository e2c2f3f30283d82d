"""The subjects of a comparison: run folders, results, and reports of the reference tool."""

from __future__ import annotations

import importlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from r2bspec.compare.comparison import ComparedSource
from r2bspec.compare.errors import UnreadableResultError
from r2bspec.compare.load_results import read_folder
from r2bspec.errors import R2bspecError
from r2bspec.judge.judge_run import from_json
from r2bspec.judge.result import Result
from r2bspec.measure.distribution import MAIN_PERCENTILES, part_value, quantile
from r2bspec.measure.metrics import MonitorMetrics, RateMetrics
from r2bspec.measure.times import rank
from r2bspec.plan.plan import Plan
from r2bspec.record.graph_identity import GraphIdentity
from r2bspec.record.run_record import SearchRecord
from r2bspec.safe_io.safe_file import is_folder, read_bytes
from r2bspec.safe_io.safe_json import MAX_JSON_BYTES

READERS: Final = ("r2bspec.interop.ros2_benchmark",)
"""Modules that read the results of other tools, imported on demand.

A reader is a module with one function, which raises an `R2bspecError` for what is not its own::

    def read_compared(content: bytes, source: str) -> ComparedResult
"""

SeriesKey = tuple[float | None, str, str]
"""Offered rate, monitor, and the metric's name in the catalogue."""


@dataclass(frozen=True)
class MetricSeries:
    """A metric in the iterations of one run.

    Attributes:
        values: None where an iteration has none, or where it is a lost message.
        single: whether it is one value for an unknown number of iterations.
        starts: the start of the processes that each was played in; empty where it is not known.
        bracket: for the peak, the highest sustained rate and the lowest that was not.
    """

    values: tuple[float | None, ...]
    unit: str
    single: bool = False
    bracket: tuple[float | None, float | None] | None = None
    starts: tuple[int, ...] = ()


@dataclass(frozen=True)
class ComparedResult:
    """One side of a comparison; None is unknown."""

    side: ComparedSource
    series: dict[SeriesKey, MetricSeries]
    plan: Plan | None
    plan_hash: str | None
    dataset: str | None
    machine: dict[str, Any] | None
    versions: dict[str, str]
    tool: str = "r2bspec"
    identity: GraphIdentity | None = None


def read_compared_result(path: Path) -> ComparedResult:
    """Read a run folder, that of a comparison, a ``result.json``, or a report of ros2_benchmark.

    A comparison is represented by its head.

    Raises:
        RecordError: a folder is neither that of a run nor of a comparison.
        UnreadableResultError: a file is none of these.
    """
    if is_folder(path):
        found = read_folder(path)
        return _of_result(str(path), found.result, found.run.plan if found.run else None)
    try:
        content = read_bytes(path, max_bytes=MAX_JSON_BYTES)
    except OSError as error:
        raise UnreadableResultError(f"{path} cannot be read: {error.strerror or error}") from error
    try:
        return _of_result(str(path), from_json(content), None)
    except ValueError as not_a_result:  # msgspec's errors are such
        reasons = []
        for name in READERS:
            try:
                compared: ComparedResult = importlib.import_module(name).read_compared(
                    content, str(path)
                )
            except R2bspecError as not_a_report:
                reasons.append(str(not_a_report))
            else:
                return compared
        raise UnreadableResultError(
            f"{path} is neither a result ({not_a_result}) nor a report ({', '.join(reasons)})",
            hint="Name a run folder, a result.json, or a report of ros2_benchmark.",
        ) from not_a_result


def _of_result(source: str, result: Result, plan: Plan | None) -> ComparedResult:
    series: dict[SeriesKey, MetricSeries] = {}
    graph = {
        each.name for each in result.processes if each.role in {"host", "command", "container"}
    }
    for rate in result.metrics.rates:
        series |= _of_rate(rate, graph)
    if result.metrics.search is not None:
        series[None, "", "peak.rate"] = _peak(result.metrics.search)
    return ComparedResult(
        side=ComparedSource(
            source=source, name=result.name, run_id=result.run_id, started_at=result.started_at
        ),
        series=series,
        plan=plan,
        plan_hash=result.plan_hash,
        dataset=str(result.dataset.get("sha256") or result.dataset.get("source") or "") or None,
        machine=result.machine,
        versions=result.versions,
        identity=result.identity,
    )


def _of_rate(rate: RateMetrics, graph: set[str]) -> dict[SeriesKey, MetricSeries]:
    found: dict[SeriesKey, MetricSeries] = {}
    starts = tuple(one.start for one in rate.iterations)
    starts = starts if all(starts) else ()
    for monitor in rate.pooled.monitors:
        seen = [one.monitors[monitor] for one in rate.iterations]
        for metric, unit, values in _of_monitor(seen):
            found[rate.offered_hz, monitor, metric] = MetricSeries(
                tuple(values), unit, starts=starts
            )
    for process in rate.pooled.processes:
        if process in graph:
            uses = [one.processes.get(process) for one in rate.iterations]
            values = [use.cpu_mean if use is not None else None for use in uses]
            found[rate.offered_hz, "", f"cpu.{process}.mean"] = MetricSeries(
                tuple(values), "share", starts=starts
            )
    return found


def _of_monitor(
    seen: Sequence[MonitorMetrics],
) -> Iterator[tuple[str, str, list[float | None]]]:
    yield "throughput.mean", "Hz", [one.throughput_hz for one in seen]
    for part in ("mean", *MAIN_PERCENTILES):
        yield f"latency.{part}", "s", [_latency(one, part) for one in seen]
    yield "drop_rate", "share", [one.drop_rate for one in seen]


def _latency(seen: MonitorMetrics, part: str) -> float | None:
    """A part of the latency; None if the percentile is a lost message."""
    q = quantile(part)
    if q is not None and seen.expected and rank(q, seen.expected) > (seen.answered or 0):
        return None
    return part_value(seen.latency, part)


def _peak(search: SearchRecord) -> MetricSeries:
    return MetricSeries((search.holds_hz,), "Hz", bracket=(search.holds_hz, search.upper_hz))
