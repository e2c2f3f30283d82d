"""Gates of the baseline as `run --against` and `run --history` make them, confirmation included.

A failed comparison is confirmed by fresh pairs, and a run that fails by its history by a fresh run,
which meets the same history again: those two are not independent.
"""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats
from simulated_gates import paired_values, run_values

from nightly import noise, size
from r2bspec.judge.baseline_comparison import HISTORY_CONFIRMATION_CONFIDENCE
from r2bspec.judge.baseline_ratio import BaselineCase, judge_history, judge_pairs
from r2bspec.judge.confirmation import confirm_requirement
from r2bspec.judge.verdict import Outcome, RequirementVerdict
from r2bspec.language.benchmark_defaults import CONFIRMATION_CONFIDENCE
from r2bspec.language.requirement_grammar import parse_requirement
from r2bspec.measure.metric_catalogue import METRICS

pytestmark = pytest.mark.simulation

GATES = size(100, 600)
BY_CHANCE = 0.068 + noise(0.05)
"""What a rate of 5 % comes to in 600 gates with bad luck (97.5 %)."""


def asked(limit: float, confidence: float = 0.95) -> BaselineCase:
    percent = f"{100 * limit:g} %"
    return BaselineCase(
        objective="no_regression",
        requirement=parse_requirement(f"throughput.mean >= {percent} of baseline"),
        at_hz=30.0,
        info=METRICS["throughput.mean"],
        monitor="out",
        limit=limit,
        confidence=confidence,
    )


def paired(random: np.random.Generator, ratio: float, case: BaselineCase) -> RequirementVerdict:
    """Ten interleaved pairs whose values vary by 2 % each, on a machine that drifts."""
    base, head = paired_values(random, 1, 10, ratio)
    return judge_pairs(case, base[0].tolist(), head[0].tolist())


def paired_outcomes(ratio: float, limit: float, seed: int) -> tuple[list[Outcome], list[Outcome]]:
    """Of many gates the outcomes of the first pairs, and those after fresh ones."""
    random = np.random.default_rng(seed)
    first: list[Outcome] = []
    last: list[Outcome] = []
    for _ in range(GATES):
        one = paired(random, ratio, asked(limit))
        first.append(one.outcome)
        if one.outcome == "fail":
            one = confirm_requirement(
                one, paired(random, ratio, asked(limit, CONFIRMATION_CONFIDENCE))
            )
        last.append(one.outcome)
    return first, last


def history_outcomes(
    ratio: float, limit: float, runs: int, seed: int
) -> tuple[list[Outcome], list[Outcome]]:
    """The same for a new run of ten iterations against so many earlier ones."""
    random = np.random.default_rng(seed)
    again = asked(limit, HISTORY_CONFIRMATION_CONFIDENCE)
    first: list[Outcome] = []
    last: list[Outcome] = []
    for _ in range(GATES):
        earlier = run_values(random, runs, 10).mean(axis=1).tolist()
        new, fresh = (run_values(random, 2, 10).mean(axis=1) * ratio).tolist()
        one = judge_history(asked(limit), earlier, new)
        first.append(one.outcome)
        if one.outcome == "fail":
            one = confirm_requirement(one, judge_history(again, earlier, fresh))
        last.append(one.outcome)
    return first, last


def share(outcomes: list[Outcome], outcome: Outcome) -> float:
    return outcomes.count(outcome) / len(outcomes)


@pytest.mark.parametrize(("limit", "most"), [(1.0, BY_CHANCE), (0.97, 0.05)])
def test_equal_graphs_in_pairs(limit: float, most: float) -> None:
    first, last = paired_outcomes(1.0, limit, seed=21)
    assert share(first, "fail") <= most
    assert share(last, "fail") <= 0.01 + noise(0.03)


@pytest.mark.parametrize("runs", [5, 10, 30])
@pytest.mark.parametrize(("limit", "most"), [(1.0, BY_CHANCE), (0.97, 0.05)])
def test_an_equal_graph_against_a_history(runs: int, limit: float, most: float) -> None:
    first, last = history_outcomes(1.0, limit, runs, seed=22)
    assert share(first, "fail") <= most
    assert share(last, "fail") <= 0.01 + noise(0.03)


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


def test_a_tenth_less_throughput_is_caught_and_confirmed() -> None:
    """Ten pairs at 2 % variation."""
    first, last = paired_outcomes(0.9, 0.97, seed=23)
    assert share(first, "fail") >= 0.95
    assert share(last, "fail") >= 0.95
    assert share(first, "pass") == 0


def test_what_sits_on_the_limit_passes_no_more_often_than_said() -> None:
    assert share(paired_outcomes(0.97, 0.97, seed=24)[1], "pass") <= BY_CHANCE
    for runs in (5, 30):
        found = history_outcomes(0.97, 0.97, runs, seed=25)[1]
        assert share(found, "pass") <= BY_CHANCE
