"""The capacity of an overloaded graph, from when its outputs leave."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from nightly import size
from r2bspec.judge.stationarity import CompletionTimes, batches, compare_pace, estimate_capacity


def play(
    intervals_s: NDArray[np.float64],
    *,
    offered_hz: float = 130.0,
    begun_s: float = 0.0,
    per_step: float = 1.0,
) -> CompletionTimes:
    times_s = np.cumsum(intervals_s)
    return CompletionTimes(begun_s, times_s, float(times_s[-1]), offered_hz, per_step)


def random_plays(
    seed: int, plays: int, hz: float = 100.0, seconds: float = 10.0
) -> list[CompletionTimes]:
    random = np.random.default_rng(seed)
    return [
        play(random.exponential(1 / hz, round(seconds * hz)), begun_s=12.0 * number)
        for number in range(plays)
    ]


def test_equal_times_give_the_capacity_exactly() -> None:
    found = estimate_capacity([play(np.full(1000, 0.01))], 0.95)
    assert found is not None
    assert found.hz == pytest.approx(100.0)
    assert found.relative_width < 1e-9


def test_random_times_are_bounded_with_the_stated_confidence() -> None:
    number = size(100, 400)
    found = [estimate_capacity(random_plays(seed, 4), 0.95) for seed in range(number)]
    held = [each is not None and each.lower_hz <= 100 <= each.upper_hz for each in found]
    # A stated 95 % that were 91 % in truth would pass once in some ten thousand.
    assert sum(held) >= number * 0.95 - 3 * math.sqrt(number * 0.05 * 0.95)


def test_four_batches_are_enough() -> None:
    assert estimate_capacity([play(np.full(560, 0.01))], 0.95) is not None
    assert estimate_capacity([play(np.full(460, 0.01))], 0.95) is None


def test_the_start_is_left_out() -> None:
    slow_first = np.concatenate([np.full(50, 0.02), np.full(900, 0.01)])
    found = estimate_capacity([play(slow_first)], 0.95)
    assert found is not None
    assert found.hz == pytest.approx(100.0)


def test_more_outputs_for_each_input_are_fewer_steps() -> None:
    found = estimate_capacity([play(np.full(1000, 0.01), per_step=4.0)], 0.95)
    assert found is not None
    assert found.hz == pytest.approx(25.0)


def test_batches_that_resemble_their_neighbours_widen_the_interval() -> None:
    wave = 0.01 * (1 + 0.2 * np.sign(np.sin(np.arange(4000) / 200)))
    shuffled = np.random.default_rng(1).permutation(wave)
    slow, mixed = (estimate_capacity([play(each)], 0.95) for each in (wave, shuffled))
    assert slow is not None
    assert mixed is not None
    assert slow.relative_width > 2 * mixed.relative_width


def test_queues_in_a_row_raise_the_upper_bound_and_only_that() -> None:
    plays = random_plays(1, 4)
    one, three = (estimate_capacity(plays, 0.95, stages=stages) for stages in (1, 3))
    assert one is not None
    assert three is not None
    assert three.upper_hz > 1.02 * one.upper_hz
    assert three.lower_hz == one.lower_hz
    equal = estimate_capacity([play(np.full(1000, 0.01))], 0.95, stages=3)
    assert equal is not None
    assert equal.relative_width < 1e-6


@pytest.mark.parametrize("outputs", [0, 1, 2, 12])
def test_too_few_outputs_say_nothing(outputs: int) -> None:
    few = CompletionTimes(0.0, np.arange(outputs) / 10.0, outputs / 10.0, 13.0)
    assert estimate_capacity([few], 0.95) is None
    assert estimate_capacity([], 0.95) is None


def test_a_play_is_saturated_if_less_leaves_than_comes() -> None:
    times = np.full(1000, 0.01)
    assert play(times, offered_hz=110.0).saturated
    assert not play(times, offered_hz=100.0).saturated
    assert play(times, offered_hz=101.0).saturated_later
    assert CompletionTimes(0.0, np.empty(0), 5.0, 100.0).saturated


def test_the_later_part_begins_anew() -> None:
    later = play(np.full(1000, 0.01), begun_s=3.0).after(4.0)
    assert later.begun_s == 7.0
    assert later.played_s == pytest.approx(6.0)
    assert 0.0 <= later.times_s[0] < 0.02
    assert batches(later).begun_s[0] >= 8.0


def test_drowned_plays_are_slower_by_what_they_are() -> None:
    drowned, gentle = [play(np.full(1000, 0.012))], [play(np.full(1000, 0.01))]
    slower, error = compare_pace(drowned, gentle)
    assert slower == pytest.approx(0.2)
    assert error == pytest.approx(0.0, abs=1e-9)
