"""``--abort-on-fail``: what it ends would not have passed, and fails as rarely by mistake."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

import msgspec
import numpy as np
import pytest

from nightly import size
from r2bspec.judge.decision_policy import certain_failures, decision_policy
from r2bspec.judge.measure.samples import RunSamples
from r2bspec.judge.pipeline import judge
from r2bspec.language.benchmark_defaults import CONFIDENCE
from r2bspec.plan.plan import Plan, PlayPlan
from run_simulation import Simulation, objective
from simulated_runs import RATE_HZ, run_of

pytestmark = pytest.mark.simulation

MESSAGES = 100
P90, P99 = "latency.p90 < 100 ms", "latency.p99 < 100 ms"
IN_STARTS = (1, 1, 2, 2, 3, 3, 4, 4, 5, 5)


def run_with(
    late: Sequence[int], starts: Sequence[int] = (1,) * 10, *, lost: bool = False
) -> RunSamples:
    """Iterations of 100 messages, of which so many are late, or lost, spread evenly."""
    rows = []
    for count in late:
        row = np.full(MESSAGES, 0.01) + np.arange(MESSAGES) * 1e-6
        if count:
            row[:: MESSAGES // count][:count] = np.nan if lost else 0.2
        rows.append(row)
    return run_of(np.array(rows), starts)


def plan_of(
    iterations: int = 10,
    starts: int = 1,
    inconclusive: Literal["report", "fail", "pass"] = "report",
    max_iterations: int = 0,
) -> Plan:
    plan = Simulation(segments=[]).plan()
    play = PlayPlan(
        rate_hz=RATE_HZ,
        duration_ns=10**9,
        iterations=iterations,
        max_iterations=max_iterations,
    )
    gate = msgspec.structs.replace(plan.gate, inconclusive=inconclusive)
    return msgspec.structs.replace(plan, play=(play,), starts=starts, gate=gate)


def certain(samples: RunSamples, plan: Plan, *texts: str) -> list[str]:
    """The requirements of these that end the rate."""
    verdict = judge({"fast": objective(*texts)}, samples, decision_policy(plan))
    return [failed.text for failed in certain_failures(verdict, samples, plan)]


@pytest.mark.parametrize(
    ("late", "text", "ended"),
    [
        # 10 % of all 1,000 are 100.
        ([20, 20], P90, False),
        # Those in bursts count for fewer.
        ([70, 60], P90, False),
        ([100, 100], P90, True),
        ([30] * 9, P90, True),
        # 115 of 1,000 are more than allowed, but no more than a graph on the limit may have.
        ([58, 57], P90, False),
        # 1 % of all are 10.
        ([4, 4], P99, False),
        ([11, 10], P99, True),
        # The next one may be another.
        ([100], P90, False),
        ([0] * 9, P99, False),
    ],
)
def test_a_rate_ends_when_the_test_of_the_whole_plan_fails(
    late: list[int], text: str, ended: bool
) -> None:
    assert bool(certain(run_with(late), plan_of(), text)) is ended


def test_all_iterations_that_may_be_added_belong_to_the_plan() -> None:
    samples = run_with([100, 100])
    assert certain(samples, plan_of(10), P90) == [P90]
    assert certain(samples, plan_of(10, max_iterations=20), P90) == []


def test_counts_and_extremes_end_a_rate_at_once_and_means_do_not() -> None:
    samples = run_with([1], lost=True)
    texts = ("missed == 0", "latency.max < 300 ms", "drop_rate == 0 %")
    assert certain(samples, plan_of(), *texts) == list(texts)
    assert certain(run_with([0]), plan_of(), "latency.min > 1 s") == ["latency.min > 1 s"]
    others = ("drop_rate <= 50 %", "throughput.mean > 99 Hz", "received == 1000", "received > 900")
    assert certain(run_with([1, 1], lost=True), plan_of(), *others) == []


def test_the_first_of_several_starts_ends_only_what_was_observed() -> None:
    plan, texts = plan_of(starts=5), (P90, "latency.max < 100 ms")
    assert certain(run_with([100, 100], IN_STARTS), plan, *texts) == [texts[1]]
    assert certain(run_with([100, 100, 100], IN_STARTS), plan, *texts) == list(texts)


def test_where_an_open_requirement_passes_only_observations_end_a_rate() -> None:
    samples, texts = run_with([100, 100]), (P90, "latency.max < 100 ms")
    assert certain(samples, plan_of(inconclusive="pass"), *texts) == [texts[1]]


@pytest.mark.parametrize("starts", [(1,) * 10, IN_STARTS], ids=["one start", "five starts"])
def test_whatever_the_rest_is_what_ended_would_not_have_passed(starts: tuple[int, ...]) -> None:
    random = np.random.default_rng(5)
    plan = plan_of(starts=len(set(starts)))
    ended = 0
    for _ in range(size(4, 100)):
        share = random.uniform(0.1, 0.6)
        counts = random.binomial(MESSAGES, share, 10).tolist()
        lengths = (
            length
            for length in range(1, 10)
            if certain(run_with(counts[:length], starts), plan, P90)
        )
        length = next(lengths, None)
        if length is None:
            continue
        ended += 1
        rests = (
            counts,
            random.binomial(MESSAGES, share / 10, 10).tolist(),
            [0] * 10,
            [MESSAGES] * 10,
            (random.integers(0, 2, 10) * MESSAGES).tolist(),
        )
        for rest in rests:
            whole = run_with(counts[:length] + rest[length:], starts)
            verdict = judge({"fast": objective(P90)}, whole, decision_policy(plan))
            assert verdict.outcome != "pass", (counts, length, rest)
    assert ended >= 2


def test_a_graph_on_its_limit_is_ended_as_rarely_as_it_fails() -> None:
    random = np.random.default_rng(7)
    plan, runs = plan_of(6), size(6, 300)
    wrong = 0
    for _ in range(runs):
        late = random.random((6, MESSAGES)) < 0.1
        latency = np.where(late, 0.2, 0.01 + random.random(late.shape) * 1e-3)
        wrong += any(certain(run_of(latency[:length]), plan, P90) for length in range(2, 7))
    # Three standard errors beyond the error that is stated.
    error = 1 - CONFIDENCE
    assert wrong <= error * runs + 3 * (error * (1 - error) * runs) ** 0.5
