"""An iteration cut into windows: which steps are in which, and what a window's values are."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from r2bspec.judge.measure.metric_catalogue import find_metric
from r2bspec.judge.measure.metric_values import has_windows, window_values, windows
from r2bspec.judge.measure.samples import SegmentSamples
from run_simulation import Played, Simulation

SECOND = 10**9


def iteration(latency: NDArray[np.float64], rate_hz: float = 10.0) -> SegmentSamples:
    (found,) = Simulation(segments=[Played(rate_hz, latency)]).samples().iterations[rate_hz]
    return found


def values(samples: SegmentSamples, metric: str) -> tuple[float, ...]:
    return window_values(find_metric(metric), "detections", samples, SECOND, math.inf).values


@pytest.mark.parametrize("rate_hz", [7.0, 10.0, 29.97, 30.0])
def test_every_step_of_whole_windows_is_in_one(rate_hz: float) -> None:
    steps = round(5 * rate_hz)
    samples = iteration(np.full(steps, 0.02), rate_hz)
    found = list(windows(samples.monitors["detections"], SECOND))
    assert len(found) in {4, 5}
    assert all(abs(one.sent - rate_hz) <= 1 for one in found)


def latencies(steps: int, *changes: tuple[slice, float]) -> NDArray[np.float64]:
    """Equal latencies, of which some are others."""
    latency = np.full(steps, 0.02)
    for part, value in changes:
        latency[part] = value
    return latency


LOST = latencies(30, (slice(12, 13), math.nan))


@pytest.mark.parametrize(
    ("latency", "metric", "expected"),
    [
        # What is left at the end is left out.
        (latencies(25, (slice(20, 25), 9.0)), "latency.max", (0.02, 0.02)),
        # A late answer is in the window in which it was asked for.
        (latencies(30, (slice(9, 10), 1.5)), "latency.max", (1.5, 0.02, 0.02)),
        (LOST, "drop_rate", (0.0, 0.1, 0.0)),
        (LOST, "missed", (0, 1, 0)),
        (LOST, "latency.max", (0.02, math.inf, 0.02)),
        (LOST, "latency.p50", (0.02, 0.02, 0.02)),
        (LOST, "throughput.mean", (10, 9, 10)),
    ],
)
def test_the_values_of_windows(
    latency: NDArray[np.float64], metric: str, expected: tuple[float, ...]
) -> None:
    assert values(iteration(latency), metric) == pytest.approx(expected)


def test_a_silent_window_is_the_worst() -> None:
    samples = iteration(latencies(30, (slice(10, 20), math.nan)))
    for metric in ("latency.mean", "interval.max", "throughput.mean", "jitter.p50"):
        assert values(samples, metric)[1] == math.inf


def test_a_window_with_too_few_messages_for_the_metric() -> None:
    samples = iteration(np.full(30, 0.02))
    found = window_values(find_metric("jitter.p50"), "detections", samples, SECOND // 5, math.inf)
    assert (found.values, found.without) == ((), 15)


def test_without_steps_there_is_no_window() -> None:
    assert values(iteration(np.empty(0)), "latency.p50") == ()


def test_metrics_that_have_windows() -> None:
    for name in ("latency.p99", "interval.max", "throughput.mean", "drop_rate", "missed"):
        assert has_windows(find_metric(name))
    for name in ("duplicates", "sent", "cpu.system.mean", "peak.rate", "playback.lateness.p99"):
        assert not has_windows(find_metric(name))
