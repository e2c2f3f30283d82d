"""Starts as the highest level of a run, and what a verdict says of them."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from r2bspec.judge.measure.samples import RunSamples
from r2bspec.judge.pipeline import judge
from r2bspec.judge.statistics.percentile_interval import level_margin
from r2bspec.judge.statistics.t_interval import hierarchical_interval
from r2bspec.judge.verdict import RequirementVerdict, Verdict
from run_simulation import Played, Simulation, objective, with_starts

STARTS = (1, 1, 2, 2, 3, 3, 4, 4, 5, 5)
NAN = float("nan")


def run(*segments: Played, starts: tuple[int, ...] = ()) -> RunSamples:
    samples = Simulation(segments=segments).samples()
    return with_starts(samples, starts or (1,) * len(segments))


def verdict(samples: RunSamples, *requirements: str) -> Verdict:
    return judge({"slo": objective(*requirements)}, samples)


def one(samples: RunSamples, requirement: str) -> RequirementVerdict:
    return verdict(samples, requirement).requirements[0]


class TestMeans:
    def test_it_is_t_over_the_starts(self) -> None:
        values = [1.0, 1.1, 5.0, 5.1, 2.0, 2.1, 4.0, 4.1, 3.0, 3.1]
        found = hierarchical_interval(values, STARTS, 0.95)
        means = np.reshape(values, (5, 2)).mean(axis=1)
        assert (found.pieces, found.number) == ("starts", 5)
        plain = stats.t.ppf(0.95, 4) * means.std(ddof=1) / math.sqrt(5)
        assert found.interval.upper - found.interval.mean >= plain - 1e-9

    def test_the_reason_counts_starts(self) -> None:
        segments = [
            Played(30, np.full(60, 0.02 + 0.001 * start + 0.0001 * (at % 2)))
            for at, start in enumerate(STARTS)
        ]
        samples = run(*segments, starts=STARTS)
        assert "10 iterations in 5 starts" in one(samples, "latency.mean < 50 ms").reason

    def test_no_latency_is_below_nothing(self) -> None:
        levels = (0.001, 0.001, 0.002, 0.002, 0.03, 0.03, 0.001, 0.001, 0.002, 0.002)
        segments = [Played(30, np.full(60, level)) for level in levels]
        found = one(run(*segments, starts=STARTS), "latency.mean < 10 ms")
        assert (found.outcome, found.lower) == ("inconclusive", 0)
        assert "the true mean is 0 s to" in found.reason


class TestLevels:
    def test_what_moves_the_whole_iteration_leaves_its_percentile_open(self) -> None:
        random = np.random.default_rng(1)
        same = [random.normal(1, 0.1, 300) for _ in range(10)]
        moved = [piece + 0.1 * (number % 3) for number, piece in enumerate(same)]
        narrow, wide = (level_margin(one, (), 0.99, 0.95) for one in (same, moved))
        assert narrow is not None
        assert wide is not None
        assert narrow.half < 0.02
        assert wide.half > 0.04
        assert wide.deviation == pytest.approx(np.std([0, 0.1, 0.2] * 3 + [0], ddof=1), rel=0.1)

    def test_the_verdict_says_what_leaves_it_open(self) -> None:
        # Each start is uniform, and no message of any is over the limit; but they differ.
        level_s = {start: 0.01 + 0.008 * place for start, place in enumerate((3, 1, 5, 2, 4), 1)}
        segments = [Played(30, np.full(300, level_s[start])) for start in STARTS]
        found = one(run(*segments, starts=STARTS), "latency.p99 < 52 ms")
        assert (found.outcome, found.over) == ("inconclusive", 0)
        assert "the 5 starts differ by 12.6 ms" in found.reason
        assert "more starts" in found.remedy or "too close" in found.remedy
        assert one(run(*segments, starts=STARTS), "latency.p99 < 1 s").outcome == ("pass")


class TestWhatItSays:
    def test_of_how_many_starts(self) -> None:
        segments = [Played(30, np.full(60, 0.02)) for _ in STARTS]
        several = verdict(run(*segments, starts=STARTS), "latency.p50 < 50 ms")
        single = verdict(run(*segments), "latency.p50 < 50 ms")
        assert (several.starts, single.starts) == (5, 1)

    def test_the_rate_with_the_fewest_starts_counts(self) -> None:
        samples = run(*(Played(30, np.full(60, 0.02)) for _ in STARTS), starts=STARTS)
        more = {**samples.iterations, 60.0: samples.iterations[30.0][:4]}
        assert replace(samples, iterations=more).starts == 2
        assert replace(samples, iterations={}).starts == 1

    def test_one_iteration_is_no_sample_of_iterations(self) -> None:
        found = one(run(Played(30, np.full(600, 0.02))), "latency.p50 < 60 ms")
        assert found.notes == ("One iteration does not show by how much iterations differ.",)


@pytest.mark.parametrize(
    ("lost", "asked", "outcome", "words"),
    [
        (150, "latency.mean < 50 ms", "inconclusive", "900 of 1,800 outputs (50 %)"),
        (2, "latency.mean < 50 ms", "pass", "leaves out 12 of 1,800 outputs"),
        (150, "latency.mean < 5 ms", "fail", "900 of 1,800"),
        (0, "latency.mean < 50 ms", "pass", ""),
    ],
)
def test_a_mean_of_what_was_not_lost(lost: int, asked: str, outcome: str, words: str) -> None:
    """A node that drops half of its outputs does not pass on the rest; a failure stays one."""
    values = 0.02 + np.linspace(0, 0.001, 300)
    values[np.linspace(5, 295, lost).astype(int)] = NAN
    found = one(run(*(Played(30, values) for _ in range(6))), asked)
    assert found.outcome == outcome
    assert words in " ".join((found.reason, *found.notes))
    assert ("drop_rate" in found.remedy) == (outcome == "inconclusive")
    assert words or not found.notes
