"""Base against head: interleaved pairs, a history of runs, and a single stored run."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats
from simulated_gates import RUN_WORLDS, history_errors, paired_gate, paired_values
from simulated_pair_looks import HEADS, errors_of_pairs

from nightly import noise, sampled, size
from r2bspec.judge.baseline_comparison import HISTORY_CONFIRMATION_CONFIDENCE
from r2bspec.judge.statistics.t_interval import noise_floor, smallest_detectable

pytestmark = pytest.mark.simulation

RUNS = size(500, 3000)
GATES = size(300, 2000)
ALIKE = RUN_WORLDS["runs differ by 2.7 %"]


@pytest.mark.parametrize("pairs", sampled([2, 3, 5, 10, 20], 2))
def test_equal_graphs_fail_in_at_most_five_percent_and_never_with_a_margin(pairs: int) -> None:
    assert paired_gate(1.0, 1.0, pairs=pairs, runs=RUNS).failed <= 0.06 + noise(0.03)
    assert paired_gate(1.0, 0.95, pairs=pairs, runs=size(100, 600)).failed == 0


def test_the_smallest_detectable_regression_is_detected_nine_times_in_ten() -> None:
    deviation = 0.02 * np.sqrt(2)
    delta = smallest_detectable(deviation, 10, 0.95)
    found = paired_gate(0.97 * np.exp(-delta), 0.97, pairs=10, runs=size(400, 2000), seed=4)
    assert found.failed == pytest.approx(0.9, abs=0.03 + noise(0.04))


def test_calibration_finds_the_noise_floor() -> None:
    random = np.random.default_rng(6)
    floors = []
    for _ in range(size(100, 500)):
        base, head = paired_values(random, 1, 20, 1.0, drift=0.0)
        floors.append(noise_floor((head / base)[0].tolist(), 0.95))
    truth = 0.02 * np.sqrt(2)
    assert np.mean([floor.deviation for floor in floors]) == pytest.approx(
        truth, rel=0.03 + noise(0.03)
    )
    assert np.mean([floor.upper >= truth for floor in floors]) >= 0.93 - noise(0.05)
    assert np.mean([floor.biased for floor in floors]) <= 0.13 + noise(0.06)


@pytest.mark.parametrize("runs", [5, 10, 30])
def test_a_history_with_a_margin_does_not(runs: int) -> None:
    """Without one it is compared with others in `test_comparisons_of_one_graph`."""
    found = history_errors(ALIKE, history=runs, limit=0.95, runs=size(100, 600))
    assert found.failed <= 0.01


@pytest.mark.parametrize("runs", [5, 10, 30])
def test_both_runs_fail_by_one_history_in_at_most_one_percent(runs: int) -> None:
    """More gates than can be judged one by one: the formula of `prediction` on whole arrays."""
    random = np.random.default_rng(26)
    earlier, new = random.normal(0, 1, (100_000, runs)), random.normal(0, 1, (100_000, 2))
    error = earlier.std(axis=1, ddof=1) * np.sqrt(1 + 1 / runs)
    t = (new - earlier.mean(axis=1)[:, np.newaxis]) / error[:, np.newaxis]
    first = t[:, 0] < stats.t.ppf(1 - 0.95, runs - 1)
    second = t[:, 1] < stats.t.ppf(1 - HISTORY_CONFIRMATION_CONFIDENCE, runs - 1)
    assert np.mean(first) == pytest.approx(0.05, abs=0.002)
    assert np.mean(first & second) <= 0.01


def test_a_history_finds_a_fifth() -> None:
    found = history_errors(ALIKE, history=10, ratio=0.8, limit=0.95, runs=size(100, 600))
    assert found.failed >= 0.99


@pytest.mark.parametrize("quantity", ["mean", "p99"])
@pytest.mark.parametrize("head", HEADS)
def test_pairs_that_may_end_early_pass_no_oftener_where_something_is_rare(
    head: str, quantity: str
) -> None:
    runs = size(20, 400)
    early = errors_of_pairs(head, quantity, 10, runs=runs)
    whole = errors_of_pairs(head, quantity, 10, looks=False, runs=runs)
    assert early.passed <= whole.passed + 0.02 + noise(0.1)
