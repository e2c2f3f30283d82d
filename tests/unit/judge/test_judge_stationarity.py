"""The capacity of an overloaded graph, from when its outputs leave, and whether it is steady.

Stops, fast starts, drift and wandering speeds are named with figures; steady graphs are not.
"""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from nightly import size
from r2bspec.judge.stationarity import (
    Capacity,
    CompletionTimes,
    estimate_capacity,
    find_nonstationarity,
)

PRECISION = 0.02


def play(
    intervals_s: NDArray[np.float64],
    begun_s: float = 0.0,
    *,
    offered_hz: float = 150.0,
    per_step: float = 1.0,
) -> CompletionTimes:
    times_s = np.cumsum(intervals_s)
    return CompletionTimes(begun_s, times_s, float(times_s[-1]), offered_hz, per_step)


def at_speeds(speeds: NDArray[np.float64], seed: int | None = None) -> NDArray[np.float64]:
    """Intervals of a graph of 100 Hz whose speed changes from message to message."""
    times = np.full(speeds.size, 0.01)
    if seed is not None:
        times = np.random.default_rng(seed).lognormal(np.log(0.01), 0.3, speeds.size)
    return times / speeds


def text(*plays: CompletionTimes) -> str:
    found = find_nonstationarity(plays, [], PRECISION)
    return "; ".join(each.text for each in found)


def service_times(kind: str, random: np.random.Generator) -> NDArray[np.float64]:
    """A thousand service times in seconds, 10 ms on average."""
    if kind == "log-normal":
        return random.lognormal(-4.6, 0.5, 1000)
    if kind == "exponential":
        return random.exponential(0.01, 1000)
    return np.full(1000, 0.01)


@pytest.mark.parametrize("kind", ["equal", "log-normal", "exponential"])
def test_a_steady_graph_is_rarely_called_anything_else(kind: str) -> None:
    called = 0
    for seed in range(size(40, 200)):
        random = np.random.default_rng(seed)
        plays = (play(service_times(kind, random), begun_s=12.0 * number) for number in range(4))
        called += bool(text(*plays))
    # Each of the tests errs once in some ten thousand.
    assert called <= 3


def test_stops_have_a_length_and_a_period() -> None:
    times = np.full(2000, 0.01)
    times[100::450] += 0.5
    assert text(play(times)) == "stops for 0.5 s about every 4.5 s"


def test_a_stop_counts_even_if_it_is_the_only_one() -> None:
    times = np.full(2000, 0.01)
    times[700] += 0.3
    assert text(play(times)) == "stopped for 0.3 s, once in 20 s"


@pytest.mark.parametrize(
    ("factor", "seconds", "said"),
    [
        (1.2, 5.0, "1.20 times faster in the first 5 s"),
        (1.5, 2.0, "1.50 times faster in the first 2 s"),
        (0.5, 1.0, "2.00 times slower in the first 1 s"),
    ],
)
def test_a_start_that_differs_is_named(factor: float, seconds: float, said: str) -> None:
    first = round(seconds * 100 * factor)
    speeds = np.concatenate([np.full(first, factor), np.ones(1200 - first)])
    assert text(play(at_speeds(speeds))) == said


def test_a_drift_is_named_over_all_plays() -> None:
    plays = [
        play(at_speeds(np.full(1000, 1.2 - 0.03 * number), number), begun_s=12.0 * number)
        for number in range(6)
    ]
    assert "times slower after" in text(*plays)


def test_a_speed_that_wanders_is_named_with_its_range() -> None:
    speeds = np.repeat(np.random.default_rng(5).permutation([1.0, 0.7] * 10), 150)
    said = text(play(at_speeds(speeds, 1)))
    assert said.startswith("its speed wanders between ")


def capacity(*plays: CompletionTimes, stages: int = 1) -> Capacity:
    found = estimate_capacity(plays, 0.95, stages=stages)
    assert found is not None
    return found


def random_plays(
    seed: int, plays: int, hz: float = 100.0, seconds: float = 10.0
) -> list[CompletionTimes]:
    random = np.random.default_rng(seed)
    return [
        play(random.exponential(1 / hz, round(seconds * hz)), begun_s=12.0 * number)
        for number in range(plays)
    ]


def test_equal_times_give_the_capacity_exactly() -> None:
    found = capacity(play(np.full(1000, 0.01)))
    assert found.hz == pytest.approx(100.0)
    assert found.relative_width < 1e-9


def test_random_times_are_bounded_with_the_stated_confidence() -> None:
    number = size(100, 400)
    found = [estimate_capacity(random_plays(seed, 4), 0.95) for seed in range(number)]
    held = [each is not None and each.lower_hz <= 100 <= each.upper_hz for each in found]
    # A stated 95 % that were 91 % in truth would pass once in some ten thousand.
    assert sum(held) >= number * 0.95 - 3 * math.sqrt(number * 0.05 * 0.95)


def test_more_outputs_for_each_input_are_fewer_steps() -> None:
    assert capacity(play(np.full(1000, 0.01), per_step=4.0)).hz == pytest.approx(25.0)


@pytest.mark.parametrize("outputs", [0, 1, 2, 12, 460])
def test_too_few_outputs_say_nothing(outputs: int) -> None:
    few = CompletionTimes(0.0, np.arange(outputs) / 100.0, outputs / 100.0, 130.0)
    assert estimate_capacity([few], 0.95) is None
    assert estimate_capacity([], 0.95) is None


def test_a_play_is_saturated_if_less_leaves_than_comes() -> None:
    times = np.full(1000, 0.01)
    assert play(times, offered_hz=110.0).saturated
    assert not play(times, offered_hz=100.0).saturated
    assert play(times, offered_hz=101.0).saturated_later
    assert CompletionTimes(0.0, np.empty(0), 5.0, 100.0).saturated


def test_what_is_slower_the_more_is_offered_is_faster_at_its_capacity() -> None:
    # A tenth longer at twice the capacity: at 1.3 and 1.07 times what comes out.
    gentle, hard = (
        play(np.full(1000, (1 + 0.1 * (offered - 1)) / 100), offered_hz=100 * offered)
        for offered in (1.06, 1.28)
    )
    found = estimate_capacity([gentle], 0.95, harder=[hard])
    assert found is not None
    assert found.hz == pytest.approx(100.0)
    assert found.drowns == pytest.approx(0.006)
    assert found.lower_hz == pytest.approx(100 / 1.006)
