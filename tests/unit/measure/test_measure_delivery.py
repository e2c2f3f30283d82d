"""What comes out of a simulated queue, estimated while it is being probed."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from nightly import noise, size
from r2bspec.judge.measure.delivery import DeliveryEstimate, delivery
from r2bspec.judge.measure.matching import match
from r2bspec.record.sample_arrays import Rows
from simulated_queues import BEGIN_NS, Server, rows


def server(offered_hz: float, seconds: float, **how: Any) -> tuple[Rows, Rows]:
    """What is recorded of a server of 100 Hz behind a queue that forgets its oldest message."""
    due_s = np.arange(int(offered_hz * seconds)) / offered_hz
    how = {"depth": 10, "spread": 0.02, "seed": 1} | how
    return rows(due_s, due_s, *Server(100.0, **how).answers(due_s))


def seen_at(offered_hz: float, recorded: tuple[Rows, Rows], time_s: float) -> DeliveryEstimate:
    """The estimate at a moment of the probe."""
    now_ns = BEGIN_NS + round(time_s * 1e9)
    playback = recorded[0][recorded[0]["published_ns"] <= now_ns]
    monitor = recorded[1][recorded[1]["received_ns"] <= now_ns]
    return delivery(offered_hz, playback, monitor, match(playback, monitor, "stamp"), now_ns)


def test_a_graph_that_keeps_up_delivers_what_is_offered() -> None:
    found = seen_at(95, server(95, 3), 3)
    assert found.completed_hz == pytest.approx(95, rel=0.002)
    assert found.player_hz == pytest.approx(95, rel=0.002)
    assert abs(found.backlog_growth_hz) < 4 * found.completed_error_hz + 0.05
    assert found.drop_share == 0


@pytest.mark.parametrize("offered_hz", [101, 105])
def test_overload_by_a_percent_shows_within_seconds(offered_hz: float) -> None:
    found = seen_at(offered_hz, server(offered_hz, 3, depth=1000), 3)
    assert found.completed_hz == pytest.approx(100, rel=0.005)
    assert found.backlog_growth_hz > 4 * found.completed_error_hz


def test_a_full_queue_turns_growth_into_drops() -> None:
    found = seen_at(200, server(200, 3), 3)
    assert found.delivered_hz == pytest.approx(100, rel=0.02)
    assert found.drop_share > 0.4


def test_drops_without_overload_are_no_backlog() -> None:
    found = seen_at(50, server(50, 4, loses=0.1), 4)
    assert abs(found.backlog_growth_hz) < 0.2
    assert 0.03 < found.drop_share < 0.2
    assert found.delivered_hz < 49


@pytest.mark.parametrize("seconds", [0.05, 0.3, 1.03, 4.0])
def test_rate_and_error_are_those_of_lines_through_batches(seconds: float) -> None:
    playback, monitor = server(60, seconds, loses=0.1)
    found = seen_at(60, (playback, monitor), seconds + 1)
    matched = match(playback, monitor, "stamp")
    steps = np.flatnonzero(matched.answered)
    times_s = (monitor["received_ns"][matched.first_row[steps]] - BEGIN_NS) / 1e9
    slope = np.polyfit(steps, times_s, 1)[0]
    assert found.completed_hz == pytest.approx(1 / slope, rel=1e-9)
    batches = min(10, steps.size // 4)
    if batches < 3:
        assert found.batches == 0
        return
    lines = zip(np.array_split(steps, batches), np.array_split(times_s, batches), strict=True)
    slopes = [np.polyfit(part, times, 1)[0] for part, times in lines]
    error = np.std(slopes, ddof=1) / np.sqrt(batches) / slope**2
    assert found.completed_error_hz == pytest.approx(error, rel=1e-6)


def test_a_graph_that_dies_is_not_remembered_as_fast() -> None:
    recorded = server(50, 3, stalls=(1.0, 1000.0))
    assert seen_at(50, recorded, 1.0).completed_hz == pytest.approx(50, rel=0.02)
    assert seen_at(50, recorded, 3.0).completed_hz < 20


def test_the_time_after_playing_is_no_silence() -> None:
    recorded = server(50, 3, loses=0.1)
    assert seen_at(50, recorded, 60.0).completed_hz == pytest.approx(50, rel=0.01)


def test_few_samples_give_wide_errors_and_no_failure() -> None:
    recorded = server(50, 3)
    nothing = seen_at(50, (recorded[0][:0], recorded[1][:0]), 0)
    assert (nothing.published, nothing.drop_share) == (0, 0)
    for time_s in (0.0, 0.001, 0.012, 0.03, 0.05, 0.1, 0.2):
        found = seen_at(50, recorded, time_s)
        assert found.completed_error_hz > 0
        assert abs(found.backlog_growth_hz) < 4 * found.completed_error_hz + 0.05


def test_messages_at_one_instant_do_not_divide_by_zero() -> None:
    playback, monitor = server(50, 1)
    monitor["received_ns"] = monitor["received_ns"][0]
    assert np.isfinite(seen_at(50, (playback, monitor), 1).completed_hz)


def test_the_standard_error_covers_the_truth() -> None:
    """In overload with scattered service times, 95 % of estimates lie within t of nine degrees."""
    hits, trials = 0, size(100, 300)
    for seed in range(trials):
        found = seen_at(150, server(150, 2, spread=0.3, depth=1000, seed=seed), 2)
        assert found.batches == 10
        hits += abs(found.completed_hz - 100) < 2.262 * found.completed_error_hz
    assert hits / trials > 0.92 - noise(0.03)
