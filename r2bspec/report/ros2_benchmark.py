"""The JSON of NVIDIA's ros2_benchmark, for programs that read its reports.

Times are milliseconds, rates frames per second, loads percent of all cores. At each fixed rate
counts and durations are the mean of an iteration, means are over all messages of all iterations,
and no iteration is left out of a maximum or a minimum. Top-level figures are those of the probe at
the highest sustained rate, or, without a search, of the highest rate that was played. Figures that
the run does not have are absent. ``docs/reports.md`` lists every key.
"""

from __future__ import annotations

import json
from bisect import bisect_left, bisect_right
from collections.abc import Sequence
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from r2bspec.compare.report_input import ReportInput
from r2bspec.diagnostics.plain_text import escaped_json
from r2bspec.judge.measure.host_usage import MACHINE_INDEX, ProcessSamples
from r2bspec.judge.measure.matching import arrivals
from r2bspec.judge.measure.run_samples import match_segment
from r2bspec.plan.plan import MonitorPlan
from r2bspec.record.run_folder import Run
from r2bspec.record.run_record import Segment
from r2bspec.report.report_wording import peak_text

_BASIC: Final = "BasicPerformanceMetrics"
_RESOURCE: Final = "ResourceMetrics"
_METADATA: Final = "BenchmarkMetadata"

PLAYBACK_MODES: Final = {"timeline": 0, "looping": 1, "sweeping": 2}
"""The numbers that a report writes for the modes of playback."""


def render(report_input: ReportInput) -> bytes:
    """The report, from the samples of the run.

    Raises:
        ReportError: only the result is known, which lacks the values of some keys.
    """
    run = report_input.require_run("the format ros2_benchmark")
    rates: dict[float, list[Segment]] = {}
    for segment in run.record.segments:
        if segment.kind == "iteration" and not segment.rerun_of and segment.complete:
            rates.setdefault(segment.rate_hz, []).append(segment)
    loads = _MachineLoad(run)
    content = _rate_figures(run, loads, _at_peak(run, rates))
    for rate_hz, segments in sorted(rates.items()):
        # A run at its own rate has only the figures above.
        if rate_hz:
            content[f"{float(rate_hz)}fps"] = _rate_figures(run, loads, segments)
    content["custom"] = dict(report_input.result.labels)
    content["metadata"] = {
        f"{_METADATA}.{key}": value for key, value in _metadata(report_input, run).items()
    }
    return escaped_json((json.dumps(content, indent=4, ensure_ascii=False) + "\n").encode())


def _at_peak(run: Run, rates: dict[float, list[Segment]]) -> list[Segment]:
    search = run.record.search
    if search is not None and search.holds_hz is not None:
        if search.holds_hz in rates:
            return rates[search.holds_hz]
        named = {probe.segment for probe in search.probes if probe.rate_hz == search.holds_hz}
        probes = [segment for segment in run.record.segments if segment.id in named]
        if probes:
            return probes[-1:]
    return rates[max(rates)] if rates else []


def _rate_figures(run: Run, loads: _MachineLoad, segments: Sequence[Segment]) -> dict[str, Any]:
    """The figures of some segments at one rate; by monitor if there are several."""
    if not segments:
        return {}
    found: dict[str, Any] = {}
    for monitor in run.plan.monitors:
        seen = [_MonitorFigures.of(run, segment, monitor) for segment in segments]
        figures = {f"{_BASIC}.{key}": value for key, value in _figures(seen).items()}
        if len(run.plan.monitors) == 1:
            found |= figures
        else:
            found[monitor.name] = figures
    return found | {f"{_RESOURCE}.{key}": value for key, value in loads.during(segments).items()}


def _figures(seen: Sequence[_MonitorFigures]) -> dict[str, float]:
    latency = np.concatenate([series.latency for series in seen])
    jitter = np.concatenate([series.jitter for series in seen])
    figures: dict[str, float | None] = {
        "RECEIVED_DURATION": _mean([series.duration for series in seen]),
        "MEAN_PLAYBACK_FRAME_RATE": _mean([series.playback_hz for series in seen]),
        "MEAN_FRAME_RATE": _mean([series.rate_hz for series in seen]),
        "NUM_MISSED_FRAMES": _mean([series.missed for series in seen]),
        "NUM_FRAMES_SENT": _mean([series.sent for series in seen]),
        "FIRST_SENT_RECEIVED_LATENCY": _mean([series.first_to_first for series in seen]),
        "LAST_SENT_RECEIVED_LATENCY": _mean([series.last_to_last for series in seen]),
    }
    if latency.size:
        figures |= {
            "FIRST_INPUT_LATENCY": _mean([float(e.latency[0]) for e in seen if e.latency.size]),
            "LAST_INPUT_LATENCY": _mean([float(e.latency[-1]) for e in seen if e.latency.size]),
            **_summary("LATENCY", latency),
        }
    if jitter.size:
        figures |= {**_summary("JITTER", jitter), "STD_DEV_JITTER": float(jitter.std())}
    return {key: value for key, value in figures.items() if value is not None}


class _MonitorFigures:
    """One iteration at one monitor, in milliseconds and frames per second."""

    def __init__(
        self, sent: NDArray[np.int64] | None, arrived: NDArray[np.int64], missed: int
    ) -> None:
        """`sent` is None where it is unknown."""
        self.sent = None if sent is None else float(sent.size)
        self.missed = None if sent is None else float(missed)
        sent = np.empty(0, np.int64) if sent is None else sent
        self.latency: NDArray[np.float64] = np.empty(0)
        self.jitter = np.abs(np.diff(arrived, 2)) / 1e6 if arrived.size > 2 else np.empty(0)
        self.duration = float(arrived[-1] - arrived[0]) / 1e6 if arrived.size > 1 else None
        self.rate_hz = _rate(arrived)
        self.playback_hz = _rate(sent)
        both = bool(sent.size and arrived.size)
        self.first_to_first = float(arrived[0] - sent[0]) / 1e6 if both else None
        self.last_to_last = float(arrived[-1] - sent[-1]) / 1e6 if both else None

    @classmethod
    def of(cls, run: Run, segment: Segment, plan: MonitorPlan) -> _MonitorFigures:
        playback, monitor, matched = match_segment(run, segment, plan)
        if segment.live:
            seen = cls(None, np.sort(monitor["received_ns"]), 0)
        else:
            seen = cls(playback["published_ns"], arrivals(monitor, matched), matched.missed)
        if not matched.pairs_known:
            return seen
        answered = matched.answered
        received = monitor["received_ns"][matched.first_row[answered]]
        seen.latency = (received - playback["published_ns"][matched.trigger_steps[answered]]) / 1e6
        return seen


def _rate(times_ns: NDArray[np.int64]) -> float | None:
    """(n - 1) / (last - first): ten messages in nine tenths of a second are 10 Hz, not 11."""
    if times_ns.size < 2 or times_ns[-1] <= times_ns[0]:
        return None
    return float((times_ns.size - 1) * 1e9 / (times_ns[-1] - times_ns[0]))


def _mean(values: Sequence[float | None]) -> float | None:
    values_known = [value for value in values if value is not None]
    return sum(values_known) / len(values_known) if values_known else None


class _MachineLoad:
    """The load of the whole machine, in percent of all cores and of all memory."""

    def __init__(self, run: Run) -> None:
        rows = ProcessSamples(run.resources()).rows(MACHINE_INDEX)
        self._times = rows["time_ns"]
        self._cores = float(run.record.machine.get("cores") or 0)
        total = float(run.record.machine.get("memory_bytes") or 0)
        self._memory = rows["memory_bytes"] * 100 / total if total else np.empty(0)
        spans = np.diff(self._times) / 1e9
        used = np.diff(rows["cpu_s"])
        usable = self._cores and bool(np.all(spans > 0))
        self._cpu = used / spans * 100 / self._cores if usable else np.empty(0)

    def during(self, segments: Sequence[Segment]) -> dict[str, float]:
        """Only while messages were played; idle time would lower the load."""
        inside = np.zeros(self._times.size, dtype=np.bool_)
        for segment in segments:
            first = bisect_left(self._times, segment.began_ns)
            inside[first : bisect_right(self._times, segment.ended_ns)] = True
        used = {
            "OVERALL_CPU": self._cpu[inside[:-1] & inside[1:]] if self._cpu.size else self._cpu,
            "HOST_MEMORY": self._memory[inside] if self._memory.size else self._memory,
        }
        shares: dict[str, float] = {}
        for name, values in used.items():
            if values.size:
                shares |= _summary(f"{name}_UTILIZATION", values)
                shares[f"STDDEV_{name}_UTILIZATION"] = float(values.std())
        return shares


def _summary(what: str, values: NDArray[np.float64]) -> dict[str, float]:
    return {
        f"MAX_{what}": float(values.max()),
        f"MIN_{what}": float(values.min()),
        f"MEAN_{what}": float(values.mean()),
    }


def _metadata(report_input: ReportInput, run: Run) -> dict[str, Any]:
    record, plan = run.record, run.plan
    machine = record.machine
    system = " ".join(str(machine[key]) for key in ("os", "kernel") if machine.get(key))
    search = record.search
    metadata = {
        "NAME": plan.title or plan.name,
        "TEST_DATETIME": record.started_at,
        "TEST_FILE_PATH": str(report_input.spec_file)
        if report_input.spec_file is not None
        else None,
        "DEVICE_ARCH": machine.get("architecture"),
        "DEVICE_OS": system or None,
        "DEVICE_HOSTNAME": machine.get("hostname"),
        "BENCHMARK_MODE": PLAYBACK_MODES.get(plan.playback_mode),
        "INPUT_DATA_PATH": record.dataset.get("path") or plan.dataset.source,
        "INPUT_DATA_HASH": record.dataset.get("sha256"),
        "INPUT_DATA_SIZE": record.dataset.get("bytes"),
        "INPUT_DATA_START_TIME": plan.dataset.start_ns / 1e9,
        "INPUT_DATA_END_TIME": (
            plan.dataset.end_ns / 1e9 if plan.dataset.end_ns is not None else None
        ),
        "PEAK_THROUGHPUT_PREDICTION": search.holds_hz if search is not None else None,
        "PEAK_THROUGHPUT": peak_text(search) if search is not None else None,
        "CONFIG": report_input.result.spec or None,
        "GENERATOR": f"r2bspec {record.versions.get('r2bspec', '')}".strip(),
    }
    return {key: value for key, value in metadata.items() if value is not None}
