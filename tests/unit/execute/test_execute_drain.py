"""How long missing answers are waited for after the last input."""

from __future__ import annotations

import pytest

from r2bspec.execute.measurement.segment_observation import (
    DrainTimer,
    Outstanding,
    outstanding_answers,
)
from r2bspec.measure.matching import MatchedMonitor, match_monitor
from run_simulation import MONITOR_PLAN, Played, monitor_rows, playback_rows

LOST = float("nan")


def matched(*latency: float) -> MatchedMonitor:
    played = Played(10.0, latency)
    playback = playback_rows(played)
    return match_monitor(playback, monitor_rows(played, playback), MONITOR_PLAN)


@pytest.mark.parametrize(
    ("latencies", "outstanding"),
    [
        ([(0.1, 0.1, 0.1)], "nothing"),
        ([(0.1, LOST, 0.1)], "gaps"),
        ([(0.1, 0.1, LOST)], "tail"),
        ([(LOST, LOST, LOST)], "tail"),
        ([(0.1, LOST, 0.1), (0.1, 0.1, 0.1)], "gaps"),
        ([(0.1, LOST, 0.1), (0.1, 0.1, LOST)], "tail"),
        ([()], "nothing"),
        ([], "nothing"),
    ],
)
def test_what_is_missing(latencies: list[tuple[float, ...]], outstanding: Outstanding) -> None:
    assert outstanding_answers(matched(*each) for each in latencies) == outstanding


def test_the_last_answers_are_waited_for_as_long_as_the_spec_says() -> None:
    timer = DrainTimer(5.0, 100.0)
    timer.arrived(100.0)
    timer.outstanding = "tail"
    assert not timer.is_over(104.9)
    assert timer.is_over(105.1)


def test_every_arrival_begins_the_wait_anew() -> None:
    timer = DrainTimer(5.0, 100.0)
    for now_s in (100.0, 104.0, 108.0):
        timer.arrived(now_s)
    timer.outstanding = "tail"
    assert not timer.is_over(112.9)
    assert timer.is_over(113.1)


def test_a_gap_is_waited_for_a_multiple_of_the_longest_pause() -> None:
    timer = DrainTimer(5.0, 100.0)
    for now_s in (100.0, 100.2, 100.4):
        timer.arrived(now_s)
    timer.outstanding = "gaps"
    assert not timer.is_over(101.3)
    assert timer.is_over(101.5)


def test_a_gap_is_never_waited_for_longer_than_the_spec_says() -> None:
    timer = DrainTimer(0.5, 100.0)
    for now_s in (100.0, 100.4):
        timer.arrived(now_s)
    timer.outstanding = "gaps"
    assert timer.is_over(101.0)


def test_what_is_missing_is_looked_up_once_after_each_arrival() -> None:
    timer = DrainTimer(5.0, 100.0)
    timer.arrived(100.0)
    assert not timer.wants_a_look(100.1)
    assert timer.wants_a_look(100.4)
    timer.outstanding = "gaps"
    assert not timer.wants_a_look(100.5)
    timer.arrived(100.6)
    assert timer.wants_a_look(101.0)


def test_a_graph_that_never_stops_publishing_is_left_after_a_minute_or_the_timeout() -> None:
    for timeout_s, end_s in ((5.0, 160.0), (90.0, 190.0)):
        timer = DrainTimer(timeout_s, 100.0)
        for now_s in range(100, 200):
            timer.arrived(float(now_s))
            timer.outstanding = "tail"
            assert timer.is_over(now_s + 0.01) == (now_s >= end_s)


def test_nothing_counts_as_lost_before_it_was_looked_up() -> None:
    timer = DrainTimer(5.0, 100.0)
    timer.arrived(100.0)
    assert timer.wants_a_look(104.0)
    assert not timer.is_over(104.0)
    timer.outstanding = "gaps"
    assert timer.is_over(104.0)
