"""How long missing answers are waited for after the last input."""

from __future__ import annotations

import pytest

from r2bspec.execute.measurement.segment_observation import (
    DrainTimer,
    Outstanding,
    outstanding_answers,
)
from r2bspec.judge.measure.matching import MatchedMonitor, match_monitor
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


@pytest.mark.parametrize(
    ("timeout_s", "arrivals_s", "outstanding", "over_after_s"),
    [
        (5.0, (100.0,), "tail", 105.0),
        # Every arrival begins the wait anew.
        (5.0, (100.0, 104.0, 108.0), "tail", 113.0),
        # A gap is waited for a multiple of the longest pause, and never longer than the spec says.
        (5.0, (100.0, 100.2, 100.4), "gaps", 101.4),
        (0.5, (100.0, 100.4), "gaps", 100.9),
    ],
)
def test_how_long_is_waited(
    timeout_s: float,
    arrivals_s: tuple[float, ...],
    outstanding: Outstanding,
    over_after_s: float,
) -> None:
    timer = DrainTimer(timeout_s, 100.0)
    for now_s in arrivals_s:
        timer.arrived(now_s)
    timer.outstanding = outstanding
    assert not timer.is_over(over_after_s - 0.1)
    assert timer.is_over(over_after_s + 0.1)


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
