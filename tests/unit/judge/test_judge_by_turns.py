"""Ratios of starts of both sides that were played by turns."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from r2bspec.judge.measure.metric_catalogue import Subjects, resolve
from r2bspec.judge.measure.samples import RunSamples
from r2bspec.judge.ratio_of_starts import can_be_played_by_turns, trimmed_interval, turn_values
from r2bspec.judge.statistics.t_interval import mean_interval
from run_simulation import Played, Simulation

SUBJECTS = Subjects(processes=("apriltag",))
NAN = math.nan


def side(latencies: list[float], work: list[float]) -> RunSamples:
    """A side whose graph was played by turns at 10 Hz; what either kind does not show is odd."""
    run, slow = (
        Simulation(segments=[Played(10, each)]).samples() for each in (latencies, [5.0, 1.0, 9.0])
    )
    free = replace(run.iterations[10][0], work={"graph": np.array([9.0, 1.0, 5.0, NAN])})
    on_a_core = replace(slow.iterations[10][0], work={"graph": np.array([*work, NAN])})
    return replace(run, turns={("turns", 10.0): free, ("work_turns", 10.0): on_a_core})


def values_of(metric: str, base: RunSamples, head: RunSamples) -> tuple[float | None, float | None]:
    monitor, info = resolve(metric, ("detections",), SUBJECTS)
    return turn_values(info, monitor, 10.0, base, head)


@pytest.mark.parametrize(
    ("metric", "by_turns"),
    [
        ("work.graph.p50", True),
        ("work.apriltag.mean", True),
        ("latency.p90", True),
        ("throughput.mean", True),
        ("cpu.graph.mean", True),
        ("latency.p99", False),
        ("latency.max", False),
        ("drop_rate", False),
        ("peak.rate", False),
        ("memory.graph.max", False),
    ],
)
def test_tails_drops_and_peaks_are_not_judged_by_turns(metric: str, by_turns: bool) -> None:
    assert can_be_played_by_turns(resolve(metric, ("detections",), SUBJECTS)[1]) is by_turns


def test_a_median_is_the_median_ratio_of_neighbouring_steps() -> None:
    # The machine slows down in the middle: both sides alike, so that no ratio changes.
    base, head = side([0.01] * 4, [1.0, 1.0, 3.0]), side([0.02] * 4, [1.1, 1.1, 3.3])
    before, after = values_of("work.graph.p50", base, head)
    assert before is not None
    assert after == pytest.approx(1.1 * before)
    before, after = values_of("latency.p50", base, head)
    assert before is not None
    assert after == pytest.approx(2 * before)


def test_a_mean_is_that_of_all_steps_of_a_side() -> None:
    base, head = side([0.01] * 4, [1.0, 1.0, 1.0]), side([0.01] * 4, [1.0, 1.0, 4.0])
    assert values_of("work.graph.mean", base, head) == pytest.approx((1.0, 2.0))
    assert values_of("work.graph.p50", base, head) == pytest.approx((1.0, 1.0))


def test_a_step_without_an_output_has_no_ratio() -> None:
    base, head = side([0.01, NAN, 0.01, 0.01], [1.0] * 3), side([0.02, 0.9, NAN, 0.02], [1.0] * 3)
    before, after = values_of("latency.p50", base, head)
    assert before is not None
    assert after == pytest.approx(2 * before)


def test_a_side_that_was_not_played_by_turns_has_no_value() -> None:
    alone = Simulation(segments=[Played(10, [0.01] * 4)]).samples()
    assert values_of("work.graph.p50", alone, side([0.01] * 4, [1.0] * 3)) == (None, None)


def test_one_odd_start_of_eight_decides_nothing() -> None:
    usual = [0.01, -0.01, 0.02, -0.02, 0.0, 0.015, -0.015]
    odd = trimmed_interval([*usual, 0.2], 0.985)
    assert odd.upper < math.log(1.05)
    assert mean_interval([*usual, 0.2], 0.985).upper > math.log(1.05)
