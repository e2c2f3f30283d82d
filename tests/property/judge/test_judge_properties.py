"""Laws of judging that hold for every sample and every bound."""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from nightly import size
from r2bspec.judge.measure.samples import RunSamples
from r2bspec.judge.pipeline import judge
from r2bspec.judge.statistics.binomial import lower_bound, upper_bound
from r2bspec.judge.statistics.t_interval import mean_interval
from r2bspec.judge.verdict import RequirementVerdict
from run_simulation import objective
from simulated_runs import run_of as simulated

ORDER = {"fail": 0, "inconclusive": 1, "pass": 2}

counts = st.integers(1, 400).flatmap(lambda n: st.tuples(st.integers(0, n), st.just(n)))
shares = st.floats(0.001, 0.999)
iterations = st.lists(
    st.tuples(st.lists(st.floats(0.001, 0.1), min_size=3, max_size=80), st.integers(0, 10)),
    min_size=1,
    max_size=3,
)


def run_of(given_iterations: list[tuple[list[float], int]]) -> RunSamples:
    """A run whose iterations have these latencies and these losses."""
    return simulated(np.array([*times, *[np.nan] * lost]) for times, lost in given_iterations)


def ask(samples: RunSamples, requirement: str) -> RequirementVerdict:
    return judge({"slo": objective(requirement)}, samples).requirements[0]


@given(counts, shares)
def test_pass_and_fail_never_both(count: tuple[int, int], allowed: float) -> None:
    k, n = count
    assert not (upper_bound(k, n, 0.95) <= allowed < lower_bound(k, n, 0.95))


@given(counts)
def test_bounds_surround_the_share(count: tuple[int, int]) -> None:
    k, n = count
    assert 0 <= lower_bound(k, n, 0.95) <= k / n <= upper_bound(k, n, 0.95) <= 1


@settings(max_examples=size(30, 200))
@given(
    iterations,
    st.sampled_from(
        ["latency.p50", "latency.p90", "latency.p99", "latency.mean", "latency.max", "interval.p90"]
    ),
    st.sampled_from(["<", "<=", ">", ">="]),
    st.lists(st.integers(1, 120), min_size=2, max_size=6),
)
def test_a_verdict_is_monotone_in_its_bound(
    given_iterations: list[tuple[list[float], int]], metric: str, op: str, limits: list[int]
) -> None:
    samples = run_of(given_iterations)
    ranks = [ORDER[ask(samples, f"{metric} {op} {limit} ms").outcome] for limit in sorted(limits)]
    assert ranks == sorted(ranks, reverse=op.startswith(">"))


@settings(max_examples=size(30, 200))
@given(
    st.lists(st.tuples(st.integers(0, 8), st.integers(0, 8)), min_size=1, max_size=10),
    st.sampled_from([60, 150, 300]),
    st.sampled_from(["0.5 %", "1 %", "5 %"]),
)
def test_fewer_losses_never_give_a_worse_verdict(
    lost: list[tuple[int, int]], messages: int, allowed: str
) -> None:
    def outcome(losses: Iterable[int]) -> str:
        latency = np.full((len(lost), messages), 0.01)
        for row, number in zip(latency, losses, strict=True):
            row[5 : 5 + number] = np.nan
        starts = [1 + place // 2 for place in range(len(lost))]
        return ask(simulated(latency, starts), f"drop_rate <= {allowed}").outcome

    assert ORDER[outcome(map(min, lost))] >= ORDER[outcome(map(max, lost))]


@settings(max_examples=size(30, 200))
@given(iterations, st.integers(1, 120), st.integers(0, 30))
def test_more_losses_never_turn_a_failure_into_a_pass(
    given_iterations: list[tuple[list[float], int]], limit: int, more: int
) -> None:
    first, *others = given_iterations
    worse = [(first[0], first[1] + more), *others]
    for requirement in (f"latency.p90 < {limit} ms", "missed <= 3"):
        before = ask(run_of(given_iterations), requirement)
        after = ask(run_of(worse), requirement)
        # Losses in a better start make starts look alike: that may decide what was open, but
        # never in favour of what had failed.
        assert (before.outcome, after.outcome) != ("fail", "pass")
        if before.share is None or after.share is None:
            assert ORDER[after.outcome] <= ORDER[before.outcome]
        else:
            assert after.share.share >= before.share.share


@settings(max_examples=size(30, 200))
@given(iterations, st.integers(1, 120))
def test_a_verdict_agrees_with_its_own_numbers(
    given_iterations: list[tuple[list[float], int]], limit: int
) -> None:
    found = ask(run_of(given_iterations), f"latency.p90 < {limit} ms")
    assert found.share is not None
    assert found.over == found.share.over <= found.n
    if found.outcome == "pass":
        assert found.upper is not None
        assert found.upper < limit / 1000
        assert found.share.upper <= 0.1 + 1e-9
    if found.outcome == "fail":
        assert found.share.lower > 0.1 - 1e-9
        assert found.lower is None or found.lower >= limit / 1000
    assert found.reason


@given(
    st.lists(st.floats(-1e6, 1e6), min_size=2, max_size=20),
    st.floats(0, 1),
    st.sampled_from([0.9, 0.95, 0.99]),
)
def test_the_interval_of_a_mean_contains_it(
    values: list[float], resolution: float, confidence: float
) -> None:
    found = mean_interval(values, confidence, resolution)
    assert found.lower <= found.mean <= found.upper
    assert math.isfinite(found.upper)
