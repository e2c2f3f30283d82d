"""Reports of NVIDIA's ros2_benchmark: reading one, and what of it is compared with a run.

A report is one JSON object: figures at the peak throughput, nested objects ``"30.0fps"`` with those
of fixed rates, ``custom`` and ``metadata``. The figures of a monitor with a prefix are in an object
of that name, at the top and inside each rate.

What a report lacks stays absent: it has no percentiles, its summary excludes the best and the worst
iteration, and its frame rate divides n messages by n - 1 intervals. The last is corrected where the
number of messages and the duration are given.
"""

from __future__ import annotations

import math
import re
from collections import ChainMap
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, Final, Literal

import msgspec

from r2bspec.compare.comparison import ComparedResult, ComparedSource, MetricSeries, SeriesKey
from r2bspec.diagnostics.plain_text import escaped_json
from r2bspec.diagnostics.quote import clip
from r2bspec.errors import ExitStatus, R2bspecError
from r2bspec.safe_io.limits import MAX_NAME_CHARACTERS, MAX_REPORT_BYTES, MAX_REPORT_FIGURES
from r2bspec.safe_io.safe_file import read_bytes
from r2bspec.safe_io.safe_json import decode_python_json

_BASIC: Final = "BasicPerformanceMetrics"
_RESOURCE: Final = "ResourceMetrics"
_METADATA: Final = "BenchmarkMetadata"
_RATE_KEY = re.compile(r"(\d+(?:\.\d+)?)fps")
_KNOWN_PREFIXES = (_BASIC, _RESOURCE, "CPUProfilingMetrics")


class NotAReportError(R2bspecError):
    """A file that is not a report of ros2_benchmark."""

    code = "R2B662"
    exit_code = ExitStatus.USAGE

    def __init__(
        self,
        message: str,
        *,
        hint: str = "Give the JSON file that the tool writes at the end of a benchmark.",
    ) -> None:
        super().__init__(message, hint=hint)


class MonitorFigures(msgspec.Struct, frozen=True, kw_only=True):
    """The figures of one monitor at one rate, in SI units; None where the report has none.

    Attributes:
        throughput_hz: (n - 1) / received_duration; None where the
            report has no counts to compute it from.
        reported_hz: the report's own MEAN_FRAME_RATE, n / received_duration.
        latency_first: of the first message; the published "latencies" are these.
        latency_mean: only in reports made with message keys; likewise min and max.
        cpu_mean: of all cores together, as a fraction of one.
    """

    received_duration: float | None = None
    playback_hz: float | None = None
    throughput_hz: float | None = None
    reported_hz: float | None = None
    sent: float | None = None
    missed: float | None = None
    latency_first: float | None = None
    latency_last: float | None = None
    latency_min: float | None = None
    latency_mean: float | None = None
    latency_max: float | None = None
    jitter_min: float | None = None
    jitter_mean: float | None = None
    jitter_max: float | None = None
    jitter_deviation: float | None = None
    cpu_mean: float | None = None
    cpu_max: float | None = None

    @property
    def drop_rate(self) -> float | None:
        """Missed / sent."""
        return self.missed / self.sent if self.missed is not None and self.sent else None


class ReferenceReport(msgspec.Struct, frozen=True, kw_only=True):
    """A report of ros2_benchmark, as far as its keys are known.

    Attributes:
        peak: the figures at the peak throughput, by monitor; the name is empty for a monitor
            without a prefix.
        rates: offered rate in Hz, as text with ``fps`` cut off, to figures by monitor.
        peak_hz: the peak found by the tool's search.
        metadata: all of it, without the prefix of its keys.
        custom: values added by the author of the benchmark.
    """

    r2bspec_reference: Literal[1] = 1
    name: str
    peak_hz: float | None
    peak: dict[str, MonitorFigures]
    rates: dict[str, dict[str, MonitorFigures]]
    metadata: dict[str, Any]
    custom: dict[str, Any]


def read_report(path: Path) -> ReferenceReport:
    """Read a report, or what `to_json` wrote of one.

    Raises:
        NotAReportError: it does not exist, is not JSON, or not such a report.
    """
    try:
        content = read_bytes(path, max_bytes=MAX_REPORT_BYTES)
    except OSError as error:
        raise NotAReportError(f"{path} cannot be read: {error.strerror or error}") from error
    return parse_report(content, str(path))


def parse_report(content: bytes, file: str = "<report>") -> ReferenceReport:
    """Read the content of a report; `file` names it in errors.

    Raises:
        NotAReportError: it is not such a report.
    """
    if len(content) > MAX_REPORT_BYTES:
        raise NotAReportError(f"{file} is larger than {MAX_REPORT_BYTES:,} bytes")
    try:
        report = decode_python_json(content)
    except msgspec.DecodeError as error:
        raise NotAReportError(f"{file} is not JSON: {error}") from error
    if isinstance(report, dict) and report.get("r2bspec_reference") == 1:
        try:
            return msgspec.convert(report, ReferenceReport)
        except msgspec.ValidationError as error:
            raise NotAReportError(f"{file} is damaged: {error}") from error
    if not isinstance(report, dict) or not any(map(_has_figures, [report, *report.values()])):
        raise NotAReportError(f"{file} is not a report of ros2_benchmark: it has no {_BASIC}")
    _check_size(report, file)
    metadata = report.get("metadata")
    plain = {
        key.removeprefix(f"{_METADATA}."): value
        for key, value in (metadata.items() if isinstance(metadata, dict) else ())
    }
    # r2bspec writes these reports, too, and divides by the number of intervals.
    exact = str(plain.get("GENERATOR", "")).startswith("r2bspec")
    custom = report.get("custom")
    return ReferenceReport(
        name=clip(str(plain.get("NAME", "")), MAX_NAME_CHARACTERS),
        peak_hz=_number(plain.get("PEAK_THROUGHPUT_PREDICTION")),
        peak=_by_monitor(report, exact=exact),
        rates={
            found[1]: _by_monitor(value, exact=exact)
            for key, value in report.items()
            if (found := _RATE_KEY.fullmatch(key)) and isinstance(value, dict)
        },
        metadata=plain,
        custom=custom if isinstance(custom, dict) else {},
    )


def _check_size(report: dict[str, Any], file: str) -> None:
    """Refuse a report whose figures would take long, or whose names would fill what shows them.

    Raises:
        NotAReportError: it has more, or longer ones, than any real one.
    """
    levels = [report, *(level for level in report.values() if isinstance(level, dict))]
    figures = sum(isinstance(value, dict) for level in levels for value in level.values())
    longest = max(len(key) for level in levels for key in level)
    if figures > MAX_REPORT_FIGURES or longest > MAX_NAME_CHARACTERS:
        raise NotAReportError(
            f"{file} has {figures:,} rates and monitors, and a name of {longest:,} characters; the "
            f"limits are {MAX_REPORT_FIGURES:,} and {MAX_NAME_CHARACTERS:,}",
            hint="Give the JSON file written by the tool, or the part of it that counts.",
        )


def to_json(report: ReferenceReport) -> bytes:
    """The report as JSON in SI units, which `read_report` reads again."""
    return escaped_json(msgspec.json.format(msgspec.json.encode(report), indent=2) + b"\n")


def read_compared(content: bytes, source: str) -> ComparedResult:
    """A report as a side of a comparison: values without their variation.

    Raises:
        NotAReportError: it is no report.
    """
    report = parse_report(content, source)
    series: dict[SeriesKey, MetricSeries] = {}
    for rate, monitors in report.rates.items():
        for monitor, figures in monitors.items():
            for metric, unit, value in _compared_values(figures):
                series[float(rate), monitor, metric] = MetricSeries((value,), unit)
    if report.peak_hz is not None:
        series[None, "", "peak.rate"] = MetricSeries((report.peak_hz,), "Hz")
    return ComparedResult(
        side=ComparedSource(
            source=source,
            name=report.name,
            run_id="",
            started_at=str(report.metadata.get("TEST_DATETIME", "")),
        ),
        series=series,
        machine={"architecture": report.metadata.get("DEVICE_ARCH")},
        tool="ros2_benchmark",
    )


def _compared_values(figures: MonitorFigures) -> Iterator[tuple[str, str, float]]:
    values = {
        ("throughput.mean", "Hz"): figures.throughput_hz,
        ("latency.mean", "s"): figures.latency_mean,
        ("drop_rate", "share"): figures.drop_rate,
    }
    for (metric, unit), value in values.items():
        if value is not None and math.isfinite(value):
            yield metric, unit, value


def _has_figures(level: object) -> bool:
    return isinstance(level, dict) and any(str(key).startswith(f"{_BASIC}.") for key in level)


def _by_monitor(level: dict[str, Any], *, exact: bool) -> dict[str, MonitorFigures]:
    """The figures of one level: those without a prefix, and one object for each prefix."""
    figures: dict[str, MonitorFigures] = {}
    if _has_figures(level):
        figures[""] = _figures(level, exact=exact)
    # The processor time belongs to the machine, not to a monitor: it is one level up.
    shared = {key: level[key] for key in level if key.startswith(_KNOWN_PREFIXES[1:])}
    for key, value in level.items():
        if isinstance(value, dict) and not _RATE_KEY.fullmatch(key) and _has_figures(value):
            figures[key] = _figures(ChainMap(value, shared), exact=exact)
    return figures


_BASIC_FIGURES: Final = {
    "received_duration": ("RECEIVED_DURATION", 1e3),
    "playback_hz": ("MEAN_PLAYBACK_FRAME_RATE", 1),
    "reported_hz": ("MEAN_FRAME_RATE", 1),
    "sent": ("NUM_FRAMES_SENT", 1),
    "missed": ("NUM_MISSED_FRAMES", 1),
    "latency_first": ("FIRST_SENT_RECEIVED_LATENCY", 1e3),
    "latency_last": ("LAST_SENT_RECEIVED_LATENCY", 1e3),
    "latency_min": ("MIN_LATENCY", 1e3),
    "latency_mean": ("MEAN_LATENCY", 1e3),
    "latency_max": ("MAX_LATENCY", 1e3),
    "jitter_min": ("MIN_JITTER", 1e3),
    "jitter_mean": ("MEAN_JITTER", 1e3),
    "jitter_max": ("MAX_JITTER", 1e3),
    "jitter_deviation": ("STD_DEV_JITTER", 1e3),
}
"""The key of each figure in a report, and how many of its units are one SI unit."""


def _figures(level: Mapping[str, Any], *, exact: bool) -> MonitorFigures:
    values = {
        name: _number(level.get(f"{_BASIC}.{key}"), units)
        for name, (key, units) in _BASIC_FIGURES.items()
    }
    for part in ("mean", "max"):
        share = _number(level.get(f"{_RESOURCE}.{part.upper()}_OVERALL_CPU_UTILIZATION"), 100)
        if share is None:  # reports before version 3 of the tool
            share = _number(level.get(f"CPUProfilingMetrics.{part.upper()}_CPU_UTIL"), 100)
        values[f"cpu_{part}"] = share
    throughput_hz, duration_s = values["reported_hz"], values["received_duration"]
    if throughput_hz is not None and not exact:
        # (n - 1) / duration from n / duration: one message per duration less.
        throughput_hz = max(throughput_hz - 1 / duration_s, 0.0) if duration_s else None
    return MonitorFigures(throughput_hz=throughput_hz, **values)


def _number(value: object, units: float = 1) -> float | None:
    """A finite number in SI units, of which `units` units are one; None for anything else."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        return None
    try:
        return float(value) / units if math.isfinite(value) else None
    except OverflowError:
        return None
