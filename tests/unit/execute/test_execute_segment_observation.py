"""Silent outputs of a segment, and how long answers are awaited."""

from __future__ import annotations

import msgspec
import numpy as np
import pytest

from r2bspec.execute.start.segment_observation import (
    DrainTimer,
    Outstanding,
    output_stopped,
    outstanding_answers,
)
from r2bspec.judge.measure.matching import MatchedMonitor, match, match_monitor
from r2bspec.record.sample_arrays import MONITOR_DTYPE
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
    assert outstanding_answers(matched(*latency) for latency in latencies) == outstanding


@pytest.mark.parametrize(
    ("timeout_s", "arrivals_s", "outstanding", "over_after_s"),
    [
        (5.0, (100.0,), "tail", 105.0),
        # Every answer begins the wait anew.
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
    timer.looked(arrivals_s[-1], outstanding, arrivals_s[-1])
    assert not timer.is_over(over_after_s - 0.1)
    assert timer.is_over(over_after_s + 0.1)


def test_a_graph_that_never_stops_answering_is_left_after_a_minute_or_the_timeout() -> None:
    for timeout_s, end_s in ((5.0, 160.0), (90.0, 190.0)):
        timer = DrainTimer(timeout_s, 100.0)
        for now_s in range(100, 200):
            timer.arrived(float(now_s))
            timer.looked(float(now_s), "tail", float(now_s))
            assert timer.is_over(now_s + 0.01) == (now_s >= end_s)


def test_nothing_counts_as_lost_before_it_was_looked_up() -> None:
    timer = DrainTimer(5.0, 100.0)
    timer.arrived(100.0)
    assert timer.wants_a_look(104.0)
    assert not timer.is_over(104.0)
    timer.looked(104.0, "gaps", 100.0)
    assert timer.is_over(104.0)


def test_a_message_with_the_stamp_of_the_last_step_is_the_last_to_wait_for() -> None:
    """Three inputs to one output, say, of which a phase decides which step is answered."""
    playback = playback_rows(Played(10.0, [LOST] * 4))
    rows = np.zeros(3, MONITOR_DTYPE)
    rows["received_ns"] = playback["published_ns"][-1] + 1_000_000
    rows["stamp_ns"] = playback["stamp_ns"][[3, 3, 3]]
    plan = msgspec.structs.replace(MONITOR_PLAN, ratio_inputs=2)
    assert outstanding_answers([match_monitor(playback, rows, plan)]) == "gaps"


NAN = float("nan")


@pytest.mark.parametrize(
    ("latency", "silent"),
    [
        ([0.01] * 20, False),
        ([0.01] * 10 + [NAN] * 10, True),
        ([NAN] * 20, True),
        ([0.01] * 16 + [NAN] * 4, False),  # so few may be lost by chance
        ([NAN] * 4, False),
        ([0.01, *[NAN] * 7] * 3, False),  # one of eight, as before
        ([0.01] + [NAN] * 19, True),
        ([], False),
        # Overloaded: each answer later than the one before, and all of them after the end.
        (list(np.linspace(0.1, 9.0, 20)), False),
    ],
)
def test_an_output_is_silent_if_much_is_waited_for_in_vain(
    latency: list[float], silent: bool
) -> None:
    played = Played(20, latency)
    playback = playback_rows(played)
    rows = monitor_rows(played, playback)
    assert output_stopped(playback, rows, match(playback, rows, "stamp")) is silent
