"""Reports of the reference tool: what is understood, what is put right, and what stays absent."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from r2bspec.compare.report_input import ReportInput
from r2bspec.interop.ros2_benchmark import NotAReportError, parse_report, read_report, to_json
from r2bspec.judge.judge_run import result_of
from r2bspec.report.ros2_benchmark import render
from run_simulation import Played, Simulation


def basic(sent: int, missed: int, duration_ms: float, **more: float) -> dict[str, float]:
    """Figures as the tool computes them: n messages divided by n - 1 intervals."""
    received = sent - missed
    found = {
        "RECEIVED_DURATION": duration_ms,
        "MEAN_FRAME_RATE": received / (duration_ms / 1e3),
        "NUM_FRAMES_SENT": sent,
        "NUM_MISSED_FRAMES": missed,
        "FIRST_SENT_RECEIVED_LATENCY": 8.4,
        "MEAN_JITTER": 0.5,
        **more,
    }
    return {f"BasicPerformanceMetrics.{key}": value for key, value in found.items()}


REPORT: dict[str, Any] = {
    **basic(649, 14, 4995.0),
    "ResourceMetrics.MEAN_OVERALL_CPU_UTILIZATION": 1.5,
    "10.0fps": basic(50, 0, 4900.0),
    "30.0fps": basic(150, 0, 4966.7, MEAN_LATENCY=9.0, MIN_LATENCY=7.0, MAX_LATENCY=12.0),
    "custom": {"data_resolution": "HD (1280,720)"},
    "metadata": {
        "BenchmarkMetadata.NAME": "a benchmark",
        "BenchmarkMetadata.PEAK_THROUGHPUT_PREDICTION": 129.8,
        "BenchmarkMetadata.DEVICE_ARCH": "x86_64",
        "BenchmarkMetadata.TEST_DATETIME": "2024-12-06T19:47:46Z",
    },
}


def parsed(report: object) -> Any:
    return parse_report(json.dumps(report).encode())


def test_a_report_is_read_in_si_units() -> None:
    report = parsed(REPORT)
    assert (report.name, report.peak_hz) == ("a benchmark", 129.8)
    figures = report.rates["30.0"][""]
    assert figures.latency_mean == pytest.approx(0.009)
    assert figures.jitter_mean == pytest.approx(0.0005)
    assert figures.latency_first == pytest.approx(0.0084)
    assert figures.drop_rate == 0
    assert report.peak[""].cpu_mean == pytest.approx(0.015)
    assert report.custom == {"data_resolution": "HD (1280,720)"}


def test_a_rate_counts_intervals_and_what_is_not_there_is_absent() -> None:
    figures = parsed(REPORT).rates["10.0"][""]
    assert figures.reported_hz == pytest.approx(10.204, abs=1e-3)
    assert figures.throughput_hz == pytest.approx(10.0, abs=1e-9)
    assert figures.latency_mean is None
    assert figures.cpu_mean is None
    only = parsed({"BasicPerformanceMetrics.NUM_FRAMES_SENT": 5})
    assert only.peak[""].throughput_hz is None
    assert only.peak[""].drop_rate is None
    assert only.rates == {}
    report = parsed({**basic(10, 0, 900.0), "BasicPerformanceMetrics.MEAN_JITTER": "INVALID"})
    assert report.peak[""].jitter_mean is None
    assert parsed(basic(5, 0, float("inf"))).peak[""].throughput_hz is None


def test_monitors_with_prefixes_are_told_apart() -> None:
    left, right = basic(50, 0, 4900.0), basic(50, 5, 4900.0)
    report = parsed({"left": left, "right": right, "10.0fps": {"left": left, "right": right}})
    assert set(report.peak) == {"left", "right"}
    assert report.rates["10.0"]["right"].missed == 5


@pytest.mark.parametrize(
    "content",
    [b"", b"[1]", b"{}", b'{"a": 1}', b'"BasicPerformanceMetrics."', b"\xff", b"[" * 9999],
)
def test_anything_else_is_refused_in_words(content: bytes) -> None:
    with pytest.raises(NotAReportError):
        parse_report(content)


def test_it_is_kept_and_read_again(tmp_path: Path) -> None:
    report = parsed(REPORT)
    path = tmp_path / "report.json"
    path.write_bytes(to_json(report))
    assert read_report(path) == report


def test_our_own_reports_come_back_with_their_own_rates(tmp_path: Path) -> None:
    run = Simulation(segments=[Played(10, [0.02] * 50)] * 2).write(tmp_path / "run")
    result = result_of(run)
    report = parse_report(render(ReportInput(result=result, run=run)))
    figures = report.rates["10.0"][""]
    seen = result.metrics.rates[0].pooled.monitors["detections"]
    assert figures.throughput_hz == pytest.approx(10.0)
    assert figures.latency_mean == pytest.approx(seen.latency.mean)
    assert figures.jitter_mean == pytest.approx(seen.jitter.mean, abs=1e-9)
    assert (figures.sent, figures.missed) == (50, 0)
    assert report.metadata["BENCHMARK_MODE"] == 1
