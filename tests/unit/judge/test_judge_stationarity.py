"""Stops, fast starts, drift and wandering speeds are named with figures; steady graphs are not."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from nightly import size
from r2bspec.judge.stationarity import CompletionTimes, find_nonstationarity

PRECISION = 0.02


def play(intervals_s: NDArray[np.float64], begun_s: float = 0.0) -> CompletionTimes:
    times_s = np.cumsum(intervals_s)
    return CompletionTimes(begun_s, times_s, float(times_s[-1]), 150.0)


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


def test_one_stop_is_an_accident() -> None:
    times = np.full(2000, 0.01)
    times[700] += 0.3
    assert "stops" not in text(play(times))


def test_stops_are_seen_in_plays_that_the_graph_keeps_up_with_too() -> None:
    times = np.full(2000, 0.01)
    times[100::450] += 0.5
    steady = play(np.full(1000, 0.01))
    (found,) = find_nonstationarity([steady], [play(times)], PRECISION)
    assert found.text.startswith("stops for 0.5 s")


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


def test_a_start_is_seen_through_the_scatter_of_messages() -> None:
    speeds = np.concatenate([np.full(600, 1.2), np.ones(600)])
    plays = [play(at_speeds(speeds, seed), begun_s=12.0 * seed) for seed in range(3)]
    assert "times faster in the first 5 s" in text(*plays)


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


def test_nothing_is_said_of_nothing() -> None:
    assert find_nonstationarity([], [], PRECISION) == ()
    assert text(CompletionTimes(0.0, np.empty(0), 5.0, 100.0)) == ""
