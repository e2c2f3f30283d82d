"""Throughput is outputs per window of time: unbiased where the graph keeps up, never too high."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from nightly import size
from r2bspec.judge.measure.sample_table import MonitorSamples
from r2bspec.judge.measure.samples import SegmentSamples
from run_simulation import Played, Simulation

SECOND = 10**9


def iteration(rate_hz: float, latency: NDArray[np.float64]) -> SegmentSamples:
    (found,) = Simulation(segments=[Played(rate_hz, latency)]).samples().iterations[rate_hz]
    return found


def measured(rate_hz: float, latency: NDArray[np.float64]) -> MonitorSamples:
    return iteration(rate_hz, latency).monitors["detections"]


def in_batches(steps: int, rate_hz: float, batch: int, lost: int = 0) -> NDArray[np.float64]:
    """Latencies of a graph that answers `batch` steps at once, but for the first `lost` of them."""
    number = np.arange(steps)
    last = (number // batch + 1) * batch - 1
    latency = (last - number) / rate_hz + 0.001 + 1e-5 * (number % batch)
    latency[(number % batch < lost) | (last >= steps)] = np.nan
    return latency


@pytest.mark.parametrize("rate_hz", [7.0, 29.97, 60.0, 1000.0])
@pytest.mark.parametrize("seconds", [1, 10])
def test_a_relay_that_answers_everything_has_the_offered_rate(rate_hz: float, seconds: int) -> None:
    rng = np.random.default_rng(1)
    latency = 0.004 + rng.uniform(0, 0.5 / rate_hz, round(seconds * rate_hz))
    seen = measured(rate_hz, latency)
    assert seen.throughput_hz == pytest.approx(rate_hz, rel=1e-6)


def test_latency_that_scatters_over_three_periods_costs_less_than_two_messages() -> None:
    rng = np.random.default_rng(2)
    found = [measured(60.0, rng.uniform(0.05, 0.1, 600)).throughput_hz for n in range(size(10, 50))]
    assert 60 * (1 - 2 / 600) <= np.mean(found) <= 60


def ending(latency: float, *last: float, steps: int) -> NDArray[np.float64]:
    """Equal latencies, of which the last ones are others."""
    return np.array([latency] * (steps - len(last)) + list(last))


HALF_LOST = ending(0.01, *[np.nan] * 50, steps=100)


@pytest.mark.parametrize(
    ("rate_hz", "latency", "expected_hz"),
    [
        pytest.param(20.0, np.full(40, 4.0), 20.0, id="a constant delay costs nothing"),
        *(
            pytest.param(30.0, in_batches(300, 30.0, batch), 30.0, id=f"bursts of {batch}")
            for batch in (2, 20, 100)
        ),
        # 250 steps in batches of 100: half a batch stays inside.
        pytest.param(25.0, in_batches(250, 25.0, 100), 20.0, id="a last burst never comes"),
        pytest.param(30.0, ending(0.01, 4.0, steps=300), 29.9, id="a straggler is one message"),
        # Nothing comes for the last 0.5 s, and everything 0.7 s after the end.
        pytest.param(
            20.0, ending(0.01, *np.linspace(1.2, 0.7, 10), steps=200), 19.0, id="a pause at the end"
        ),
        pytest.param(10.0, HALF_LOST, 5.0, id="a graph that dies"),
        pytest.param(10.0, HALF_LOST[::-1], 5.0, id="a graph that begins late"),
        *(
            pytest.param(0.5, np.full(steps, 0.3), 0.5, id=f"{steps} messages")
            for steps in (1, 2, 3)
        ),
    ],
)
def test_the_throughput_of_a_graph(
    rate_hz: float, latency: NDArray[np.float64], expected_hz: float
) -> None:
    assert measured(rate_hz, latency).throughput_hz == pytest.approx(expected_hz)


def test_bursts_with_losses_do_not_look_faster_than_what_came_out() -> None:
    samples = iteration(20.0, in_batches(200, 20.0, batch=20, lost=3))
    seen = samples.monitors["detections"]
    assert (seen.sent, seen.answered) == (200, 170)
    assert seen.throughput_hz == pytest.approx(17.0)


def test_a_graph_slower_than_its_input_has_its_own_rate() -> None:
    # 20 Hz of 30, from a queue without an end: all are answered, half of them after the window.
    latency = np.linspace(0.05, 0.05 + 299 * (1 / 20 - 1 / 30), 300)
    assert measured(30.0, latency).throughput_hz == pytest.approx(20, rel=0.005)
