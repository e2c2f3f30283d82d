"""Verdicts on simulated runs: each requirement, each outcome, and why."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest
from numpy.typing import NDArray

from r2bspec.judge.decision_policy import decision_policy
from r2bspec.judge.measure.run_samples import read_samples
from r2bspec.judge.measure.samples import RunSamples
from r2bspec.judge.pipeline import judge
from r2bspec.judge.verdict import (
    InconclusivePolicy,
    Level,
    Outcome,
    RequirementVerdict,
    Verdict,
    outcome_of,
)
from r2bspec.language.quantities import Share
from r2bspec.plan.smoke_plan import smoke_plan
from r2bspec.record.run_folder import open_run
from r2bspec.record.run_record import SearchRecord
from run_simulation import Played, Simulation, objective, probe, renew_digests

NAN = float("nan")


def latencies(n: int, *, over: int = 0, lost: int = 0) -> NDArray[np.float64]:
    """20 ms each, but `over` times 100 ms, and `lost` outputs that never came, evenly spread."""
    found = np.full(n, 0.02)
    bad = np.linspace(0, n - 1, over + lost).astype(int)
    found[bad[:over]] = 0.1
    found[bad[over:]] = NAN
    return found


def samples_of(*segments: Played, **fields: object) -> RunSamples:
    simulation = Simulation(segments=segments, **fields)  # type: ignore[arg-type]
    return simulation.samples()


def ask(samples: RunSamples, *requirements: str, at: str = "30 Hz") -> Verdict:
    return judge({"slo": objective(*requirements, at=at)}, samples)


def one(samples: RunSamples, requirement: str, at: str = "30 Hz") -> RequirementVerdict:
    (found,) = ask(samples, requirement, at=at).requirements
    return found


ASKED = "latency.p99 < 60 ms"
BASES = [np.full(30, base) for base in (0.018, 0.020, 0.022)]


@pytest.mark.parametrize(
    ("played", "requirement", "outcome", "words"),
    [
        ([latencies(100)] * 3, ASKED, "pass", "of 300 outputs"),
        ([latencies(100)] * 2, ASKED, "inconclusive", "1 more iteration"),
        ([latencies(1000, lost=900)], "latency.p50 > 1 ms", "fail", ""),
        # Messages on the limit.
        ([latencies(1000)], "latency.p99 <= 20 ms", "pass", ""),
        ([latencies(1000)], "latency.p99 < 20 ms", "fail", ""),
        # Nearly all is not all, and that nothing is ever lost cannot be proved.
        (
            [latencies(2000, over=1994)],
            "latency.p50 < 60 ms",
            "fail",
            "1,994 of 2,000 outputs (99.7 %)",
        ),
        ([latencies(1000)], "drop_rate <= 0 %", "inconclusive", "missed == 0"),
        ([latencies(1000, lost=100)], "drop_rate > 1 %", "pass", ""),
        ([latencies(1000, lost=100)], "drop_rate > 50 %", "fail", ""),
        (BASES, "latency.mean < 30 ms", "pass", ""),
        (BASES, "latency.mean < 10 ms", "fail", ""),
        (BASES, "latency.mean < 20.5 ms", "inconclusive", "would decide it"),
        ([latencies(300)], "throughput.mean > 1 Hz", "inconclusive", "2 iterations"),
        # Iterations that agree exactly are no proof to the last digit.
        ([latencies(30)] * 3, "latency.mean < 20.1 ms", "pass", ""),
        ([latencies(30)] * 3, "latency.mean < 20.0001 ms", "inconclusive", ""),
        ([latencies(90)] * 2, "cpu.apriltag.mean < 60 %", "pass", ""),
        ([latencies(90)] * 2, "cpu.apriltag.mean < 40 %", "fail", ""),
        ([latencies(90)] * 2, "cpu.system.mean < 100 %", "pass", ""),
        ([latencies(90)] * 2 + [[NAN] * 90], "latency.mean < 30 ms", "fail", "iteration 3"),
        ([latencies(90, over=1), latencies(90)], "latency.max < 60 ms", "fail", ""),
        ([latencies(300)], "missed == 0", "pass", "an observation, not a proof"),
        ([[], []], "playback.lateness.p99 < 1 s", "inconclusive", ""),
        ([[], []], "drop_rate < 1 %", "fail", ""),
        ([[], []], "playback.rate > 1 Hz", "fail", ""),
        ([latencies(90)], "throughput.mean >= 97 % of baseline", "inconclusive", "baseline"),
    ],
)
def test_what_runs_at_30_hz_decide(
    played: list[Any], requirement: str, outcome: str, words: str
) -> None:
    found = one(samples_of(*(Played(30, each) for each in played)), requirement)
    assert found.outcome == outcome
    assert words in f"{found.reason} {found.remedy}"


def test_of_offered_is_worked_out() -> None:
    found = one(samples_of(*[Played(30, latencies(90))] * 2), "throughput.mean >= 97 % of offered")
    assert (found.outcome, found.unit) == ("pass", "Hz")
    assert found.limit == pytest.approx(29.1)


def test_lost_estimates_and_observations_are_labelled_so() -> None:
    lost = one(samples_of(Played(30, latencies(100, lost=5))), "latency.p99 < 1 s")
    assert (lost.outcome, lost.estimate, lost.lost) == ("fail", None, True)
    seen = one(samples_of(Played(30, latencies(300))), "missed == 0")
    assert seen.method == "observation"
    assert seen.rule_of_three == pytest.approx(3 / 300, rel=0.01)
    open_ = one(samples_of(Played(30, latencies(90))), "latency.p50 <= 105 % of baseline")
    assert (open_.method, open_.limit) == ("none", None)


class TestPercentiles:
    @pytest.mark.parametrize(
        ("n", "over", "lost", "outcome"),
        [
            (1000, 0, 0, "pass"),
            (1000, 4, 0, "pass"),
            (1000, 5, 0, "inconclusive"),
            (1000, 10, 0, "inconclusive"),
            (1000, 15, 0, "inconclusive"),
            (1000, 16, 0, "fail"),
            (1000, 0, 17, "fail"),
            (1000, 9, 8, "fail"),
            (298, 0, 0, "inconclusive"),
            (299, 0, 0, "pass"),
        ],
    )
    def test_the_exact_binomial_test_decides(
        self, n: int, over: int, lost: int, outcome: str
    ) -> None:
        found = one(
            samples_of(Played(30, latencies(n, over=over, lost=lost))),
            "latency.p99 < 60 ms",
        )
        assert found.outcome == outcome
        assert found.method == "exact binomial"
        assert (found.n, found.over) == (n, over + lost)
        assert found.share is not None
        assert found.share.lost == lost
        assert bool(found.remedy) == (outcome == "inconclusive")

    @pytest.mark.parametrize(
        ("lost", "outcome"), [(0, "pass"), (3, "pass"), (10, "inconclusive"), (17, "fail")]
    )
    def test_drops_are_judged_on_the_same_counts(self, lost: int, outcome: str) -> None:
        found = one(samples_of(Played(30, latencies(1000, lost=lost))), "drop_rate <= 1 %")
        assert (found.outcome, found.estimate) == (outcome, lost / 1000)

    def test_estimate_and_bounds_are_in_the_metric_s_unit(self) -> None:
        values = np.random.default_rng(1).gamma(20, 0.001, 3000)
        found = one(samples_of(Played(30, values)), "latency.p99 < 60 ms")
        assert found.estimate == pytest.approx(np.quantile(values, 0.99, method="inverted_cdf"))
        assert found.estimate is not None
        assert found.lower is not None
        assert found.upper is not None
        assert found.lower < found.estimate < found.upper < 0.06 == found.limit
        assert "3,000 outputs" in found.reason


class TestObservations:
    @pytest.mark.parametrize(
        ("requirement", "outcome"),
        [
            ("missed == 0", "fail"),
            ("missed != 0", "pass"),
            ("missed <= 2", "pass"),
            ("latency.max < 1 s", "fail"),
            ("latency.min > 10 ms", "pass"),
            ("received >= 298", "pass"),
            ("duplicates == 0", "fail"),
            ("sent == 300", "pass"),
            ("interval.max < 150 ms", "pass"),
            ("memory.apriltag.max < 1 GiB", "pass"),
            ("cpu.apriltag.max < 40 %", "fail"),
            ("drop_rate == 0 %", "fail"),
            ("latency.p50 == 20 ms", "pass"),
        ],
    )
    def test_comparisons(self, requirement: str, outcome: str) -> None:
        values = latencies(300)
        values[[10, 200]] = NAN
        samples = samples_of(Played(30, values, twice=(0,)))
        found = one(samples, requirement)
        assert (found.outcome, found.method) == (outcome, "observation")


def bracket(holds: float | None, fails: float | None, limited_by: str = "graph") -> SearchRecord:
    return SearchRecord(
        probes=(probe(5, holds=True), probe(200, holds=False)),
        holds_hz=holds,
        fails_hz=fails,
        limited_by=limited_by,  # type: ignore[arg-type]
    )


class TestSearch:
    @pytest.mark.parametrize(
        ("requirement", "search", "outcome"),
        [
            ("peak.rate >= 100 Hz", bracket(100, 102), "pass"),
            ("peak.rate > 100 Hz", bracket(100, 102), "inconclusive"),
            ("peak.rate >= 101 Hz", bracket(100, 102), "inconclusive"),
            ("peak.rate >= 102 Hz", bracket(100, 102), "fail"),
            ("peak.rate < 102 Hz", bracket(100, 102), "pass"),
            ("peak.rate < 101 Hz", bracket(100, 102), "inconclusive"),
            ("peak.rate < 100 Hz", bracket(100, 102), "fail"),
            ("peak.rate <= 100 Hz", bracket(100, 102), "inconclusive"),
            ("peak.rate >= 300 Hz", bracket(200, None, "range"), "inconclusive"),
            ("peak.rate >= 200 Hz", bracket(200, None, "range"), "pass"),
            ("peak.rate >= 150 Hz", bracket(100, 120, "player"), "inconclusive"),
            ("peak.rate >= 100 Hz", bracket(100, 120, "player"), "pass"),
            ("peak.rate >= 10 Hz", bracket(None, 5), "fail"),
            ("peak.rate >= 3 Hz", bracket(None, 5), "inconclusive"),
            ("peak.rate < 10 Hz", bracket(None, 5), "pass"),
            ("peak.rate >= 10 Hz", None, "inconclusive"),
        ],
    )
    def test_the_bracket_decides_what_lies_outside_it(
        self, requirement: str, search: SearchRecord | None, outcome: str
    ) -> None:
        found = one(samples_of(search=search), requirement, at="")
        assert found.outcome == outcome
        assert bool(found.remedy) == (outcome == "inconclusive")

    def test_sustained_is_what_its_probe_says(self) -> None:
        samples = samples_of(
            sustained=(probe(35, holds=True), probe(50, holds=False, reason="it grows"))
        )
        assert one(samples, "sustained", at="35 Hz").outcome == "pass"
        assert one(samples, "sustained", at="50 Hz").outcome == "fail"
        assert "it grows" in one(samples, "sustained", at="50 Hz").reason
        assert one(samples, "sustained", at="60 Hz").outcome == "inconclusive"

    def test_a_player_that_gives_up_says_nothing_about_the_graph(self) -> None:
        slow = Played(50, latencies(100), late=np.linspace(0, 1, 100), kind="sustained")
        samples = samples_of(slow, sustained=(probe(50, holds=False),))
        verdict = ask(samples, "sustained", at="50 Hz")
        assert verdict.outcome == "invalid"


class TestWhatWasNotMeasured:
    """Nothing that is not there can pass."""

    @pytest.mark.parametrize(
        ("strangers", "requirement", "cause"),
        [(0, "received == 0", "received nothing"), (30, "latency.p50 < 1 s", "has the stamp")],
    )
    def test_a_monitor_without_answers_is_named_as_the_cause(
        self, strangers: int, requirement: str, cause: str
    ) -> None:
        found = one(samples_of(Played(30, [NAN] * 30, strangers=strangers)), requirement)
        assert found.outcome == "fail"
        assert cause in found.reason

    @pytest.mark.parametrize(
        ("requirement", "reason"),
        [
            ("latncy.p99 < 60 ms", "did you mean latency.p99"),
            ("other.latency.p99 < 60 ms", "no monitor 'other'"),
            ("latency.p99 < 60 Hz", "is a time"),
            ("cpu.nobody.mean < 60 %", "no metric"),
        ],
    )
    def test_what_does_not_exist_fails(self, requirement: str, reason: str) -> None:
        found = one(samples_of(Played(30, latencies(300))), requirement)
        assert found.outcome == "fail"
        assert reason in found.reason

    @pytest.mark.parametrize(
        ("complete", "requirement", "at"),
        [
            (True, ASKED, "60 Hz"),
            (True, ASKED, ""),
            (True, "throughput.mean > 9 % of offered", ""),
            (False, ASKED, "30 Hz"),
        ],
    )
    def test_a_rate_that_was_not_played_to_its_end(
        self, complete: bool, requirement: str, at: str
    ) -> None:
        samples = samples_of(Played(30, latencies(300), complete=complete))
        assert one(samples, requirement, at=at).outcome == "inconclusive"

    def test_resources_that_were_not_sampled(self, tmp_path: Path) -> None:
        run = Simulation(segments=[Played(30, latencies(60))] * 2).write(tmp_path)
        (tmp_path / "resources.npy").unlink()
        renew_digests(tmp_path)
        run = open_run(tmp_path)
        assert one(read_samples(run), "cpu.apriltag.mean < 99 %").outcome == "inconclusive"
        assert one(read_samples(run), "cpu.apriltag.max < 99 %").outcome == "inconclusive"


class TestTheWhole:
    def test_a_requirement_without_a_monitor_holds_for_each(self) -> None:
        samples = samples_of(Played(30, latencies(300), silent=("b",)), monitors=("a", "b"))
        verdict = ask(samples, "latency.p50 < 60 ms")
        assert [
            (requirement.monitor, requirement.outcome) for requirement in verdict.requirements
        ] == [
            ("a", "pass"),
            ("b", "fail"),
        ]

    @pytest.mark.parametrize(
        ("requirements", "outcome", "exit_code"),
        [
            ((), "pass", 0),
            (("latency.p50 < 60 ms",), "pass", 0),
            (("latency.p50 < 60 ms", "throughput.mean > 1 Hz"), "inconclusive", 3),
            (("latency.p50 < 1 ms", "throughput.mean > 1 Hz"), "fail", 1),
        ],
    )
    def test_the_worst_decides(
        self, requirements: tuple[str, ...], outcome: str, exit_code: int
    ) -> None:
        verdict = ask(samples_of(Played(30, latencies(300))), *requirements)
        assert (verdict.outcome, verdict.exit_code) == (outcome, exit_code)

    @pytest.mark.parametrize("status", ["invalid", "incomplete"])
    def test_a_run_that_is_not_complete_passes_nothing(self, status: str) -> None:
        samples = samples_of(Played(30, latencies(300)), status=status, reason="a node died")
        verdict = ask(samples, "latency.p50 < 60 ms")
        assert (verdict.outcome, verdict.exit_code, verdict.reason) == (status, 4, "a node died")
        assert verdict.requirements[0].outcome == "pass"

    @pytest.mark.parametrize(
        ("late", "usable"),
        [
            (np.zeros(300), True),
            (np.full(300, 0.015), True),
            (np.full(300, 0.018), False),
            (np.linspace(0, 1, 300), False),
            (np.where(np.arange(300) < 3, 0.1, 0), True),
            (np.where(np.arange(300) < 6, 0.1, 0), False),
        ],
    )
    def test_playback_that_missed_its_schedule_makes_a_run_invalid(
        self, late: NDArray[np.float64], usable: bool
    ) -> None:
        samples = samples_of(Played(30, latencies(300), late=late), Played(60, [0.01]))
        verdict = ask(samples, "latency.p50 < 60 ms")
        assert (verdict.outcome == "pass") == usable
        assert (verdict.exit_code == 4) != usable
        assert bool(verdict.unusable) != usable

    @pytest.mark.parametrize(("held_s", "usable"), [(0.0, True), (0.09, True), (0.11, False)])
    def test_a_monitor_that_had_no_processor_makes_a_run_invalid(
        self, held_s: float, usable: bool
    ) -> None:
        # Ten seconds, of which one in a hundred may be unwatched.
        samples = samples_of(Played(30, latencies(300), held=held_s))
        verdict = ask(samples, "latency.p50 < 60 ms")
        assert (verdict.outcome == "pass") == usable
        assert (verdict.exit_code == 4) != usable
        assert usable or "no processor for 110 ms" in verdict.reason

    def test_a_rate_that_no_objective_uses_spoils_a_run_without_objectives_alone(self) -> None:
        late = Played(60, latencies(300), late=np.linspace(0, 1, 300))
        samples = samples_of(Played(30, latencies(300)), late)
        assert ask(samples, "latency.p50 < 60 ms").outcome == "pass"
        verdict = judge({}, samples)
        assert (verdict.outcome, verdict.exit_code) == ("invalid", 4)
        assert [one.offered_hz for one in verdict.unusable] == [60]


class TestSeverity:
    @pytest.mark.parametrize(
        ("levels", "outcomes", "policy", "overall"),
        [
            (("error", "error"), ("pass", "fail"), "report", "fail"),
            (("error", "warn"), ("pass", "fail"), "report", "pass"),
            (("error", "info"), ("pass", "inconclusive"), "report", "pass"),
            (("error",), ("inconclusive",), "report", "inconclusive"),
            (("error",), ("inconclusive",), "fail", "fail"),
            (("error",), ("inconclusive",), "pass", "pass"),
            (("error", "error"), ("inconclusive", "fail"), "pass", "fail"),
            (("warn",), ("fail",), "fail", "pass"),
        ],
    )
    def test_levels_and_the_policy(
        self,
        levels: tuple[Level, ...],
        outcomes: tuple[Outcome, ...],
        policy: InconclusivePolicy,
        overall: str,
    ) -> None:
        judged = one(samples_of(Played(30, latencies(1000))), ASKED)
        requirements = [
            msgspec.structs.replace(judged, level=level, outcome=outcome)
            for level, outcome in zip(levels, outcomes, strict=True)
        ]
        found, sentence = outcome_of(requirements, policy)
        assert found == overall
        assert ("warning" in sentence) == (
            any(
                level == "warn" and outcome != "pass"
                for level, outcome in zip(levels, outcomes, strict=True)
            )
            or (policy == "pass" and "inconclusive" in outcomes)
        )

    def test_what_is_off_is_not_judged(self) -> None:
        samples = samples_of(Played(30, latencies(300, over=60)))
        off = msgspec.structs.replace(objective(ASKED), level="off")
        assert judge({"slo": off}, samples).requirements == ()

    def test_an_objective_has_a_confidence_of_its_own(self) -> None:
        samples = samples_of(Played(30, latencies(300)))
        sure = msgspec.structs.replace(objective(ASKED), confidence=Share(0.99))
        (found,) = judge({"slo": sure}, samples).requirements
        assert (found.outcome, found.confidence) == ("inconclusive", 0.99)


SLOS = {"fast": objective("latency.p90 < 1 us")}


def test_the_slos_and_a_late_playback_of_a_smoke_run_do_not_matter(tmp_path: Path) -> None:
    late = Played(30, latencies(60), late=np.full(60, 0.5))
    written = Simulation(segments=[late], objectives=SLOS).write(tmp_path / "run")
    samples = read_samples(written)
    plan = smoke_plan(msgspec.structs.replace(written.plan, objectives=SLOS))
    verdict = judge(plan.objectives, samples, decision_policy(plan))
    assert (verdict.outcome, verdict.requirements) == ("pass", ())
    assert verdict.reason == "The graph works; a smoke run does not judge the SLOs."
    # The same run, measured.
    assert judge(SLOS, samples, replace(decision_policy(plan), smoke=False)).outcome == "invalid"
    # A run that was cut short shows nothing.
    record = msgspec.structs.replace(samples.record, status="incomplete", reason="It was cut.")
    cut = judge(plan.objectives, replace(samples, record=record), decision_policy(plan))
    assert (cut.outcome, cut.reason) == ("incomplete", "It was cut.")
