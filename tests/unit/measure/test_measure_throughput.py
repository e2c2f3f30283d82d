"""Throughput is outputs per window of time: unbiased where the graph keeps up, never too high."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from nightly import size
from r2bspec.measure.metric_catalogue import METRICS
from r2bspec.measure.metric_values import window_values
from r2bspec.measure.run_samples import read_samples
from r2bspec.measure.samples import MonitorSamples, SegmentSamples
from r2bspec.measure.times import throughput
from run_simulation import EPOCH_NS, Played, Simulation

SECOND = 10**9


def iteration(path: Path, rate_hz: float, latency: NDArray[np.float64]) -> SegmentSamples:
    run = Simulation(segments=[Played(rate_hz, latency)]).write(path)
    (found,) = read_samples(run).iterations[rate_hz]
    return found


def measured(path: Path, rate_hz: float, latency: NDArray[np.float64]) -> MonitorSamples:
    return iteration(path, rate_hz, latency).monitors["detections"]


def in_batches(steps: int, rate_hz: float, batch: int, lost: int = 0) -> NDArray[np.float64]:
    """Latencies of a graph that answers `batch` steps at once, but for the first `lost` of them."""
    number = np.arange(steps)
    last = (number // batch + 1) * batch - 1
    latency = (last - number) / rate_hz + 0.001 + 1e-5 * (number % batch)
    latency[(number % batch < lost) | (last >= steps)] = np.nan
    return latency


@pytest.mark.parametrize("rate_hz", [7.0, 29.97, 60.0, 1000.0])
@pytest.mark.parametrize("seconds", [1, 10])
def test_a_relay_that_answers_everything_has_the_offered_rate(
    tmp_path: Path, rate_hz: float, seconds: int
) -> None:
    rng = np.random.default_rng(1)
    latency = 0.004 + rng.uniform(0, 0.5 / rate_hz, round(seconds * rate_hz))
    seen = measured(tmp_path, rate_hz, latency)
    assert seen.throughput_hz == pytest.approx(rate_hz, rel=1e-6)


def test_latency_that_scatters_over_three_periods_costs_less_than_two_messages(
    tmp_path: Path,
) -> None:
    rng = np.random.default_rng(2)
    found = [
        measured(tmp_path / f"{n}", 60.0, rng.uniform(0.05, 0.1, 600)).throughput_hz
        for n in range(size(10, 50))
    ]
    assert 60 * (1 - 2 / 600) <= np.mean(found) <= 60


def test_a_constant_delay_of_seconds_costs_nothing(tmp_path: Path) -> None:
    assert measured(tmp_path, 20.0, np.full(40, 4.0)).throughput_hz == pytest.approx(20)


def test_bursts_with_losses_do_not_look_faster_than_what_came_out(tmp_path: Path) -> None:
    seen = measured(tmp_path, 20.0, in_batches(200, 20.0, batch=20, lost=3))
    assert (seen.sent, seen.answered) == (200, 170)
    assert seen.throughput_hz == pytest.approx(17.0)


@pytest.mark.parametrize("batch", [2, 20, 100])
def test_bursts_without_losses_have_the_offered_rate(tmp_path: Path, batch: int) -> None:
    seen = measured(tmp_path, 30.0, in_batches(300, 30.0, batch))
    assert seen.throughput_hz == pytest.approx(30.0)


def test_a_last_burst_that_never_comes_is_missing(tmp_path: Path) -> None:
    # 250 steps in batches of 100: half a batch stays inside.
    seen = measured(tmp_path, 25.0, in_batches(250, 25.0, 100))
    assert seen.throughput_hz == pytest.approx(20.0)


def test_a_graph_slower_than_its_input_has_its_own_rate(tmp_path: Path) -> None:
    # 20 Hz of 30, from a queue without an end: all are answered, half of them after the window.
    latency = np.linspace(0.05, 0.05 + 299 * (1 / 20 - 1 / 30), 300)
    assert measured(tmp_path, 30.0, latency).throughput_hz == pytest.approx(20, rel=0.005)


def test_one_straggler_counts_as_one_message(tmp_path: Path) -> None:
    latency = np.full(300, 0.01)
    latency[-1] = 4.0
    assert measured(tmp_path, 30.0, latency).throughput_hz == pytest.approx(29.9)


def test_a_pause_at_the_end_delays_its_messages_beyond_the_window(tmp_path: Path) -> None:
    # Nothing comes for the last 0.5 s, and everything 0.7 s after the end.
    latency = np.full(200, 0.01)
    latency[190:] = np.linspace(1.2, 0.7, 10)
    assert measured(tmp_path, 20.0, latency).throughput_hz == pytest.approx(19.0)


def test_a_graph_that_dies_or_begins_late_has_no_rate_for_that_time(tmp_path: Path) -> None:
    latency = np.full(100, 0.01)
    latency[:50] = np.nan
    assert measured(tmp_path / "late", 10.0, latency).throughput_hz == pytest.approx(5.0)
    assert measured(tmp_path / "died", 10.0, latency[::-1]).throughput_hz == pytest.approx(5.0)


@pytest.mark.parametrize("steps", [1, 2, 3])
def test_short_iterations_of_few_messages(tmp_path: Path, steps: int) -> None:
    seen = measured(tmp_path, 0.5, np.full(steps, 0.3))
    assert seen.throughput_hz == pytest.approx(0.5)


def test_nothing_is_no_rate() -> None:
    assert throughput(np.empty(0, np.int64), EPOCH_NS, SECOND) == 0
    assert throughput(np.array([EPOCH_NS]), EPOCH_NS, 0) == 0


def test_windows_of_a_rate_that_does_not_divide_them_have_it_too(tmp_path: Path) -> None:
    samples = iteration(tmp_path, 29.97, np.full(300, 0.01))
    found = window_values(METRICS["throughput.mean"], "detections", samples, SECOND, 0.0)
    assert len(found.values) == 10
    assert found.values == pytest.approx([29.97] * 10, rel=1e-6)


def test_bursts_with_losses_in_windows(tmp_path: Path) -> None:
    samples = iteration(tmp_path, 20.0, in_batches(200, 20.0, batch=20, lost=3))
    found = window_values(METRICS["throughput.mean"], "detections", samples, SECOND, 0.0)
    assert found.values == pytest.approx([17.0] * 10)
