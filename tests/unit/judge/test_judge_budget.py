"""What an interval is made of, what cannot be told apart, and what narrows it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import msgspec
import numpy as np
import pytest
from numpy.typing import NDArray

from r2bspec.judge.decision_policy import DecisionPolicy
from r2bspec.judge.measure.host_usage import HostInterference
from r2bspec.judge.pipeline import judge
from r2bspec.judge.statistics.variance_components import (
    NestedSample,
    growth_for_share,
    pieces_for,
    quantile_scale,
)
from r2bspec.judge.verdict import RequirementVerdict, UncertaintyBudget
from r2bspec.record.run_record import HarnessOverheadRecord, StartRecord
from run_simulation import objective
from simulated_runs import run_of

STARTS = (1, 1, 2, 2, 3, 3, 4, 4, 5, 5)
MEAN = "latency.mean < 30 ms"


def messages(
    between: float = 0.0, inside: float = 0.001, starts: Sequence[int] = STARTS, n: int = 300
) -> NDArray[np.float64]:
    """Latencies in seconds, shape (iterations, messages), with these standard deviations.

    Starts differ in no order; two iterations of a start by a little, in opposite directions.
    """
    random = np.random.default_rng(7)
    noise = random.standard_normal((len(starts), n))
    noise -= noise.mean(axis=1, keepdims=True)
    order = np.array([0, -1.3, 0.6, -0.6, 1.3])
    levels = between * order[np.array(starts) % order.size]
    levels += inside * np.resize([0.1, -0.1], len(starts))
    return np.asarray(0.02 + levels[:, np.newaxis] + inside * noise)


def requirement(
    latency: NDArray[np.float64],
    text: str = MEAN,
    starts: Sequence[int] = STARTS,
    *,
    interference: Sequence[HostInterference] = (),
    overhead_ns: Sequence[tuple[int, int]] = (),
    start_s: float = 0.0,
) -> RequirementVerdict:
    run = run_of(latency, starts, interference)
    overhead = [
        HarnessOverheadRecord(
            topic="/image",
            bytes=1,
            rate_hz=30,
            sent=90,
            received=90,
            latency_p50_ns=p50_ns,
            latency_p99_ns=p99_ns,
            lateness_p50_ns=None,
            lateness_p99_ns=None,
        )
        for p50_ns, p99_ns in overhead_ns
    ]
    record = msgspec.structs.replace(
        run.record,
        harness_overhead=tuple(overhead),
        starts=tuple(
            StartRecord(number=number, began_ns=0, ready_ns=round(start_s * 1e9))
            for number in sorted(set(starts))
        ),
    )
    verdict = judge({"slo": objective(text)}, replace(run, record=record), DecisionPolicy())
    return verdict.requirements[0]


def budget(found: RequirementVerdict) -> UncertaintyBudget:
    assert found.budget is not None
    return found.budget


def shares(found: RequirementVerdict) -> dict[str, float | None]:
    return {part.source: part.share for part in budget(found).parts}


class TestComponents:
    def test_an_unbalanced_sample_agrees_with_the_analysis_of_variance(self) -> None:
        values, starts = [1.0, 3.0, 5.0, 9.0, 10.0, 11.0], [1, 1, 2, 2, 2, 3]
        found = NestedSample.of(values, starts)
        inside = (2 + 14) / 3
        between = (2 * (2 - 6.5) ** 2 + 3 * (8 - 6.5) ** 2 + (11 - 6.5) ** 2) / 2
        assert found.sizes == (2, 3, 1)
        assert found.iterations == pytest.approx(inside)
        assert found.starts == pytest.approx((between - inside) / ((6 - 14 / 6) / 2))
        assert found.variance == pytest.approx(found.starts * 14 / 36 + found.iterations / 6)

    def test_starts_that_agree_better_than_their_iterations_do_not_differ(self) -> None:
        found = NestedSample.of([1.0, 3.0, 3.0, 1.0], [1, 1, 2, 2], sampling=0.1)
        assert found.starts == 0
        assert found.iterations == pytest.approx(4 / 3 - 0.1)

    def test_the_density_at_a_percentile(self) -> None:
        ordered = np.sort(np.random.default_rng(2).random(100_000))
        assert quantile_scale(ordered, float(ordered[90_000])) == pytest.approx(1, rel=0.2)
        lost = np.array([1.0, 2.0, np.inf])
        assert quantile_scale(lost, 2.0) == 0


class TestGrowth:
    def test_more_starts_than_these_are_not_proposed(self) -> None:
        assert pieces_for(4.0, 5, None) == 20
        assert pieces_for(4.0, 5, 0.95) == 14
        assert pieces_for(1000.0, 5, 0.95) is None

    def test_a_share_that_may_be_the_allowed_one_is_not_decided(self) -> None:
        few, many = (growth_for_share(0.0, n, 0.01, 0.95) * n for n in (100.0, 200.0))
        assert 299 < many < few
        assert growth_for_share(10.0, 1000.0, 0.01, 0.95) > 10


class TestBudget:
    def test_one_start_says_nothing_of_starts(self) -> None:
        starts = (1,) * 10
        found = requirement(messages(starts=starts), starts=starts)
        assert shares(found)["starts"] is None
        assert (
            budget(found).parts[0].unknown == "One start does not show by how much starts differ."
        )
        assert "starts" not in budget(found).halve

    def test_one_iteration_in_each_start_is_a_start(self) -> None:
        starts = (1, 2, 3, 4, 5)
        found = shares(requirement(messages(between=0.002, starts=starts), starts=starts))
        assert found["iterations"] is None
        assert (found["starts"] or 0) > (found["sampling"] or 0)

    def test_one_iteration_has_sampling_alone(self) -> None:
        text, starts = "latency.p50 < 30 ms", (1,)
        found = shares(requirement(messages(starts=starts), text, starts))
        assert found["starts"] is found["iterations"] is None
        assert (found["sampling"] or 0) > 0.3

    def test_a_metric_without_messages(self) -> None:
        found = shares(requirement(messages(), "throughput.mean > 1 Hz"))
        assert found["sampling"] is found["harness"] is None

    @pytest.mark.parametrize("text", [MEAN, "latency.p50 < 30 ms"])
    def test_the_harness_is_a_part_of_the_sampling(self, text: str) -> None:
        latency = messages()
        without = shares(requirement(latency, text))
        spread = np.quantile(latency, 0.99) - np.quantile(latency, 0.5)
        half = shares(requirement(latency, text, overhead_ns=[(0, round(spread * 0.5e9))]))
        assert without["harness"] is None
        assert half["harness"] == pytest.approx(0.25 * (without["sampling"] or 0), rel=0.01)
        assert half["sampling"] == pytest.approx(0.75 * (without["sampling"] or 0), rel=0.01)
        assert half["starts"] == without["starts"]

    def test_an_interval_without_an_end_has_that_of_its_other_side(self) -> None:
        few = messages(starts=(1, 1), n=60)
        found = requirement(few, "latency.p99 < 30 ms", (1, 1))
        assert found.upper is None
        assert found.estimate is not None
        assert found.lower is not None
        assert budget(found).half_width == pytest.approx(found.estimate - found.lower)

    def test_what_has_no_interval_has_no_budget(self) -> None:
        assert requirement(messages(), "latency.max < 1 s").budget is None
        lost = np.full((10, 30), np.nan)
        lost[:, :3] = 0.02
        assert requirement(lost, "latency.p50 < 1 s").budget is None


class TestWhatHalvesIt:
    def test_starts_cost_what_they_took(self) -> None:
        latency = messages(between=0.002)
        cheap, dear = (budget(requirement(latency, start_s=each)) for each in (0.0, 100.0))
        assert cheap.halve.startswith("To halve it: 14 starts with 28 iterations, about ")
        # Nine starts more, of two iterations of 10 s, and half a second after each.
        assert cheap.halve_s == pytest.approx(189)
        assert dear.halve_s == pytest.approx(189 + 900)

    def test_iterations_where_starts_are_dear_and_do_not_differ(self) -> None:
        found = budget(requirement(messages(), start_s=1000.0))
        assert "starts with" not in found.halve
        assert "4 times as long" in found.halve or "iterations in 5 starts" in found.halve

    def test_another_placement_where_the_harness_scatters(self) -> None:
        latency = messages(starts=(1,) * 10, n=60)
        found = budget(requirement(latency, starts=(1,) * 10, overhead_ns=[(0, 10**8)]))
        assert (found.halve_s, found.halve) == (
            None,
            "Another 'harness.placement' would more than halve it.",
        )

    def test_an_idle_host_where_affected_iterations_scatter(self) -> None:
        latency = messages()
        latency[1] += 0.02
        quiet = HostInterference(seconds=10.0, cores=8, steal=0.0)
        stolen = msgspec.structs.replace(quiet, steal=0.2)
        interference = [stolen if place == 1 else quiet for place in range(10)]
        found = budget(requirement(latency, interference=interference))
        assert found.halve.startswith("An idle host would more than halve it: others affected 1 of")
        alike = budget(requirement(messages(), interference=interference))
        assert "idle" not in alike.halve

    def test_the_clock(self) -> None:
        found = requirement(np.full((10, 30), 0.02))
        assert budget(found).halve == "The resolution of the clock limits it."
        assert (shares(found)["clock"] or 0) > 0.2

    def test_few_messages_are_not_limited_by_the_clock(self) -> None:
        found = requirement(messages(starts=(1, 1, 1), n=2), "latency.p90 < 1 s", (1, 1, 1))
        assert "clock" not in budget(found).halve

    def test_nothing_bad_is_bounded_by_the_number_of_messages(self) -> None:
        found = budget(requirement(messages(), "drop_rate <= 5 %"))
        assert "2 times as long" in found.halve or "20 iterations" in found.halve


@pytest.mark.filterwarnings("error")
def test_lost_messages_beside_the_middle_half_leave_its_components_finite() -> None:
    """A quarter is lost: every level is known, and no interpolation reaches what is lost."""
    random = np.random.default_rng(1)
    latency = 0.02 + 0.01 * random.standard_normal((3, 1))
    latency = latency + 0.001 * random.standard_normal((3, 300))
    latency[:, ::4] = np.nan
    found = budget(requirement(latency, "latency.p50 < 20.5 ms", (1, 2, 3)))
    assert all(part.share is None or np.isfinite(part.share) for part in found.parts)


def test_no_latency_is_below_nothing_where_some_are_lost() -> None:
    """Lost outputs count as the worst, which of a lower limit is minus infinity."""
    latency = messages(inside=0.0001) * np.array([[1, 1, 1, 1, 1, 1, 15, 15, 25, 25]]).T
    latency[0, :3] = np.nan
    found = requirement(latency, "latency.p50 >= 10 ms")
    assert found.lower == 0
