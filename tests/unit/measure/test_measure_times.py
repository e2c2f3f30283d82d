"""Matching, latency, throughput and processor time on samples with known answers."""

from __future__ import annotations

import numpy as np
import pytest

from r2bspec.judge.measure.host_usage import ProcessSamples, total_use
from r2bspec.judge.measure.matching import arrivals, match
from r2bspec.judge.measure.times import edge_gaps, intervals, jitter, mean_rate, percentile, rank
from r2bspec.record.sample_arrays import RESOURCE_DTYPE, Rows
from run_simulation import EPOCH_NS, Played, monitor_rows, playback_rows, samples_of

NAN = float("nan")


def matched(played: Played) -> tuple[Rows, Rows]:
    playback = playback_rows(played)
    return playback, monitor_rows(played, playback)


class TestMatching:
    def test_losses_duplicates_and_strangers_are_told_apart(self) -> None:
        playback, monitor = matched(Played(10, [0.01, NAN, 0.01, 0.01], twice=(2, 2), strangers=3))
        found = match(playback, monitor, "stamp")
        assert found.answered.tolist() == [True, False, True, True]
        assert (found.missed, found.duplicates, found.unmatched) == (1, 2, 3)

    def test_an_overtaken_answer_is_reordered_and_not_lost(self) -> None:
        playback, monitor = matched(Played(10, [0.25, 0.01, 0.01, 0.01]))
        found = match(playback, monitor, "stamp")
        seen = samples_of(playback, monitor, found)
        assert (seen.reordered, seen.missed) == (1, 0)
        assert seen.latency[0] == pytest.approx(0.25, abs=1e-9)

    def test_by_order_the_kth_message_answers_the_kth_step(self) -> None:
        playback, monitor = matched(Played(10, [0.01, NAN, 0.01], twice=(2, 2)))
        found = match(playback, monitor, "order")
        assert found.step.tolist() == [0, 1, 2, -1]
        assert (found.missed, found.duplicates, found.unmatched) == (0, 0, 1)


class TestTimes:
    def test_a_nanosecond_survives_weeks_of_uptime(self) -> None:
        playback, monitor = matched(Played(10, [0.010000001, 0.010000002]))
        found = match(playback, monitor, "stamp")
        assert samples_of(playback, monitor, found).latency.tolist() == [0.010000001, 0.010000002]

    def test_latency_from_due_includes_the_wait_of_the_playback(self) -> None:
        playback, monitor = matched(Played(10, [0.01, 0.01], late=[0, 0.03]))
        found = match(playback, monitor, "stamp")
        seen = samples_of(playback, monitor, found)
        assert seen.latency == pytest.approx([0.01, 0.01])
        assert seen.latency_from_due == pytest.approx([0.01, 0.04])

    def test_intervals_and_jitter(self) -> None:
        playback, monitor = matched(Played(10, [0.01, 0.02, 0.01]))
        arrived = arrivals(monitor, match(playback, monitor, "stamp"))
        assert intervals(arrived) == pytest.approx([0.11, 0.09])
        assert jitter(arrived) == pytest.approx([0.02])
        assert jitter(arrived[:2]).size == 0
        assert intervals(arrived[:0]).size == 0


class TestPercentiles:
    def test_nearest_rank(self) -> None:
        values = np.array([5.0, 1.0, 4.0, 2.0, 3.0])
        assert [percentile(values, q) for q in (0, 0.2, 0.21, 0.5, 0.99, 1)] == [1, 1, 2, 3, 5, 5]

    def test_whole_ranks_are_not_pushed_up_by_rounding(self) -> None:
        assert rank(0.07, 100) == 7
        assert rank(0.99, 100) == 99
        assert rank(0.999, 1000) == 999

    def test_nothing_has_no_percentile(self) -> None:
        assert percentile(np.empty(0), 0.5) is None
        assert percentile(np.empty(0), 0.5, lost=1) == float("inf")


class TestThroughput:
    def test_n_events_bound_n_minus_1_periods(self) -> None:
        assert mean_rate(EPOCH_NS + np.arange(51) * 10**8) == 10.0
        assert mean_rate(np.array([EPOCH_NS])) == 0.0
        assert mean_rate(np.empty(0, np.int64)) == 0.0

    def test_ordinary_pauses_at_the_ends_are_no_gaps(self) -> None:
        arrived = EPOCH_NS + np.arange(51) * 10**8
        silent = edge_gaps(arrived, EPOCH_NS - 10**7, int(arrived[-1]) + 9 * 10**7)
        assert silent == (0, 0)

    def test_a_graph_that_died_leaves_a_gap(self) -> None:
        arrived = EPOCH_NS + np.arange(26) * 10**8
        assert edge_gaps(arrived, EPOCH_NS, EPOCH_NS + 5 * 10**9)[1] == 25 * 10**8


class TestResources:
    def sampled(self, times_s: list[float], cpu_s: list[float], process: int = 0) -> Rows:
        rows = np.zeros(len(times_s), RESOURCE_DTYPE)
        rows["time_ns"] = EPOCH_NS + np.round(np.array(times_s) * 1e9).astype(np.int64)
        rows["cpu_s"] = cpu_s
        rows["process"] = process
        rows["memory_bytes"] = np.arange(len(times_s)) * 100
        return rows

    def window(self, rows: Rows, begin_s: float, end_s: float) -> tuple[float | None, float | None]:
        began_ns, ended_ns = EPOCH_NS + round(begin_s * 1e9), EPOCH_NS + round(end_s * 1e9)
        used = ProcessSamples(rows).used(began_ns, ended_ns)[0]
        return used.cpu_mean, used.cpu_max

    def test_only_the_window_counts(self) -> None:
        # Idle for a second, one core for a second, idle again.
        rows = self.sampled([0, 1, 2, 3], [5, 5, 6, 6])
        assert self.window(rows, 1, 2) == pytest.approx((1.0, 1.0))
        assert self.window(rows, 0.5, 2.5) == pytest.approx((0.5, 1.0))
        assert self.window(rows, 1.25, 1.75) == pytest.approx((1.0, 1.0))

    def test_what_was_not_sampled_is_not_guessed(self) -> None:
        rows = self.sampled([0, 1], [0, 1])
        assert self.window(rows, 0.5, 1.25) == pytest.approx((1.0, 1.0))
        assert self.window(rows, 0.9, 2) == (None, None)
        sampled = ProcessSamples(rows)
        assert sampled.used(EPOCH_NS + 2 * 10**9, EPOCH_NS + 3 * 10**9) == {}
        assert sampled.used(EPOCH_NS + 10**9, EPOCH_NS) == {}
        assert ProcessSamples(rows[:0]).used(EPOCH_NS, EPOCH_NS + 10**9) == {}

    def test_the_maximum_of_a_sum_is_not_the_sum_of_the_maxima(self) -> None:
        # Two processes that are busy one after the other: one core at any time.
        rows = np.concatenate(
            (
                self.sampled([0, 1, 2], [0, 1, 1]),
                self.sampled([0.01, 1.01, 2.01], [7, 7, 8], process=1),
            )
        )
        sampled, ended_ns = ProcessSamples(rows), EPOCH_NS + 2 * 10**9
        together = sampled.used_together([0, 1], EPOCH_NS, ended_ns)
        assert together is not None
        assert together.cpu_mean == pytest.approx(1.0, abs=0.02)
        assert together.cpu_max == pytest.approx(1.0, abs=0.02)
        assert total_use([*sampled.used(EPOCH_NS, ended_ns).values()]).cpu_max == pytest.approx(2.0)
        assert together.memory_max_bytes == pytest.approx(399, abs=2)
        alone = sampled.used(EPOCH_NS, ended_ns)[0]
        assert sampled.used_together([0], EPOCH_NS, ended_ns) == alone
        assert sampled.used_together([2], EPOCH_NS, ended_ns) is None
