"""What comes out of a simulated queue, estimated while it is being probed."""

from __future__ import annotations

from collections import deque

import numpy as np
import pytest

from nightly import noise, size
from r2bspec.judge.measure.delivery import DeliveryEstimate, delivery
from r2bspec.judge.measure.matching import match
from r2bspec.record.sample_arrays import MONITOR_DTYPE, PLAYBACK_DTYPE, Rows

START_NS = 10**15


def server(
    offered_hz: float,
    capacity_hz: float,
    seconds: float,
    *,
    scatter: float = 0.02,
    depth: int = 10,
    loses: float = 0.0,
    dies_s: float = np.inf,
    seed: int = 1,
) -> tuple[Rows, Rows]:
    """One server behind a queue that forgets its oldest message when it is full."""
    rng = np.random.default_rng(seed)
    n = int(offered_hz * seconds)
    due = np.arange(n) / offered_hz
    published = due + np.abs(rng.normal(0, 1e-4, n))
    waiting: deque[int] = deque()
    out: list[tuple[int, float]] = []
    now, coming = 0.0, 0
    while coming < n or waiting:
        if not waiting:
            now = max(now, float(published[coming]))
            waiting.append(coming)
            coming += 1
        step = waiting.popleft()
        now += rng.normal(1 / capacity_hz, scatter / capacity_hz)
        while coming < n and published[coming] <= now:
            waiting.append(coming)
            coming += 1
            if len(waiting) > depth:
                waiting.popleft()
        if rng.random() >= loses and now < dies_s:
            out.append((step, now + rng.exponential(2e-4)))
    playback, monitor = np.zeros(n, PLAYBACK_DTYPE), np.zeros(len(out), MONITOR_DTYPE)
    playback["stamp_ns"] = np.arange(n) + 1
    playback["due_ns"] = START_NS + np.round(due * 1e9).astype(np.int64)
    playback["published_ns"] = START_NS + np.round(published * 1e9).astype(np.int64)
    monitor["stamp_ns"] = [step + 1 for step, _ in out]
    monitor["received_ns"] = [START_NS + round(time * 1e9) for _, time in out]
    return playback, monitor


def seen_at(offered_hz: float, rows: tuple[Rows, Rows], time_s: float) -> DeliveryEstimate:
    """The estimate at a moment of the probe."""
    now_ns = START_NS + round(time_s * 1e9)
    playback = rows[0][rows[0]["published_ns"] <= now_ns]
    monitor = rows[1][rows[1]["received_ns"] <= now_ns]
    return delivery(offered_hz, playback, monitor, match(playback, monitor, "stamp"), now_ns)


def test_a_graph_that_keeps_up_delivers_what_is_offered() -> None:
    found = seen_at(95, server(95, 100, 3), 3)
    assert found.completed_hz == pytest.approx(95, rel=0.002)
    assert found.player_hz == pytest.approx(95, rel=0.002)
    assert abs(found.backlog_growth_hz) < 4 * found.completed_error_hz + 0.05
    assert found.drop_share == 0


@pytest.mark.parametrize("offered_hz", [101, 105])
def test_overload_by_a_percent_shows_within_seconds(offered_hz: float) -> None:
    found = seen_at(offered_hz, server(offered_hz, 100, 3, depth=1000), 3)
    assert found.completed_hz == pytest.approx(100, rel=0.005)
    assert found.backlog_growth_hz > 4 * found.completed_error_hz


def test_a_full_queue_turns_growth_into_drops() -> None:
    found = seen_at(200, server(200, 100, 3), 3)
    assert found.delivered_hz == pytest.approx(100, rel=0.02)
    assert found.drop_share > 0.4


def test_drops_without_overload_are_no_backlog() -> None:
    found = seen_at(50, server(50, 100, 4, loses=0.1), 4)
    assert abs(found.backlog_growth_hz) < 0.2
    assert 0.03 < found.drop_share < 0.2
    assert found.delivered_hz < 49


def test_a_graph_that_dies_is_not_remembered_as_fast() -> None:
    rows = server(50, 100, 3, dies_s=1.0)
    assert seen_at(50, rows, 1.0).completed_hz == pytest.approx(50, rel=0.02)
    assert seen_at(50, rows, 3.0).completed_hz < 20


def test_the_time_after_playing_is_no_silence() -> None:
    rows = server(50, 100, 3, loses=0.1)
    assert seen_at(50, rows, 60.0).completed_hz == pytest.approx(50, rel=0.01)


def test_few_samples_give_wide_errors_and_no_failure() -> None:
    rows = server(50, 100, 3)
    nothing = seen_at(50, (rows[0][:0], rows[1][:0]), 0)
    assert (nothing.published, nothing.drop_share) == (0, 0)
    for time_s in (0.0, 0.001, 0.012, 0.03, 0.05, 0.1, 0.2):
        found = seen_at(50, rows, time_s)
        assert found.completed_error_hz > 0
        assert abs(found.backlog_growth_hz) < 4 * found.completed_error_hz + 0.05


def test_messages_at_one_instant_do_not_divide_by_zero() -> None:
    playback, monitor = server(50, 100, 1)
    monitor["received_ns"] = monitor["received_ns"][0]
    assert np.isfinite(seen_at(50, (playback, monitor), 1).completed_hz)


def test_the_standard_error_covers_the_truth() -> None:
    """In overload with scattered service times, 95 % of estimates lie within t of nine degrees."""
    hits, trials = 0, size(100, 300)
    for seed in range(trials):
        found = seen_at(150, server(150, 100, 2, scatter=0.3, depth=1000, seed=seed), 2)
        assert found.batches == 10
        hits += abs(found.completed_hz - 100) < 2.262 * found.completed_error_hz
    assert hits / trials > 0.92 - noise(0.03)
