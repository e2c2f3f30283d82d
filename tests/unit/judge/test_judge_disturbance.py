"""Iterations affected by host interference: found, played again, and judged."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import msgspec
import numpy as np
import pytest

from r2bspec import api
from r2bspec.execute.measurement.measurement import iterations_to_rerun
from r2bspec.judge.affected_iterations import REMEDY, best_case_iteration
from r2bspec.judge.decision_policy import DecisionPolicy
from r2bspec.judge.measure.host_usage import HostInterference, interference_reasons, taken_share
from r2bspec.judge.measure.samples import RunSamples
from r2bspec.judge.pipeline import judge
from r2bspec.judge.verdict import InterferencePolicy, Outcome, RequirementVerdict, Verdict
from r2bspec.record.run_record import Probe, SearchRecord
from run_simulation import Played, Simulation, objective, with_interference

FAST = np.full(300, 0.02)
SLOW = np.where(np.arange(300) % 5 == 0, 0.1, 0.02)
HOPELESS = np.full(300, 0.5)
SOME = np.where(np.arange(300) % 100 == 50, 0.1, 0.02)
RANDOM = np.random.default_rng(7)
LATENCIES = {
    "pass": FAST,
    "fail": SLOW,
    "hopeless": HOPELESS,
    "inconclusive": SOME,
    "fast": RANDOM.uniform(0.010, 0.030, 300),
    "slow": RANDOM.uniform(0.055, 0.075, 300),
    "far": RANDOM.uniform(5.0, 6.0, 300),
}
ASKED = "latency.p99 < 60 ms"
P90 = "latency.p90 < 50 ms"

QUIET = HostInterference(
    seconds=10.0,
    cores=8,
    steal=0.0,
    foreign_cores=0.1,
    pressure=0.05,
    throttled_s=0.0,
)
STOLEN = msgspec.structs.replace(QUIET, steal=0.02)
BUSY = HostInterference(
    seconds=10.0,
    cores=2,
    threads_per_core=2,
    foreign_cores=1.8,
    pressure=0.9,
    own_cores=0.2,
    own_waited=0.3,
)


class TestWhatDisturbs:
    @pytest.mark.parametrize(
        ("field", "value", "word"),
        [
            ("steal", 0.02, "stolen"),
            ("foreign_cores", 1.0, "other processes"),
            ("throttled_s", 0.2, "throttled"),
        ],
    )
    def test_one_thing_is_enough(self, field: str, value: float, word: str) -> None:
        odd = msgspec.structs.replace(QUIET, **{field: value})
        assert interference_reasons(QUIET) == ()
        (found,) = interference_reasons(odd)
        assert word in found

    def test_what_is_not_known_disturbs_nothing(self) -> None:
        assert interference_reasons(HostInterference(pressure=1.0)) == ()
        assert interference_reasons(None) == ()


def run(
    *iterations: Mapping[str, HostInterference | None],
    again: Mapping[int, tuple[str, HostInterference]] | None = None,
) -> RunSamples:
    """A run of iterations that are named by what they would lead to; and of reruns by number."""
    outcomes = [name for iteration in iterations for name in iteration]
    again = again or {}
    played = [Played(30, LATENCIES[name]) for name in outcomes]
    played += [Played(30, LATENCIES[name]) for name, _ in again.values()]
    samples = Simulation(segments=played).samples()
    found = samples.iterations[30.0]
    known = [around for iteration in iterations for around in iteration.values()]
    first = tuple(
        replace(one, interference=around)
        for one, around in zip(found[: len(known)], known, strict=True)
    )
    reruns = {
        first[number].segment.id: replace(
            one,
            interference=around,
            segment=msgspec.structs.replace(one.segment, rerun_of=first[number].segment.id),
        )
        for one, (number, (_, around)) in zip(found[len(known) :], again.items(), strict=True)
    }
    return replace(samples, iterations={30.0: first}, reruns=reruns)


def judged(samples: RunSamples, asked: str = ASKED, policy: InterferencePolicy = "note") -> Verdict:
    return judge({"slo": objective(asked)}, samples, DecisionPolicy(interference=policy))


class TestWhatTheyMayDo:
    @pytest.mark.parametrize(
        ("first", "again", "outcome"),
        [
            ("fail", "pass", "inconclusive"),
            ("fail", "fail", "fail"),
            ("pass", "fail", "pass"),
            ("inconclusive", "pass", "inconclusive"),
        ],
    )
    def test_a_failure_may_be_weakened_and_nothing_else(
        self, first: str, again: str, outcome: Outcome
    ) -> None:
        samples = run(
            {first: STOLEN},
            {first: STOLEN},
            again={0: (again, QUIET), 1: (again, QUIET)},
        )
        found = judged(samples)
        assert found.outcome == outcome
        assert found.requirements[0].weakened == (first == "fail" and outcome != "fail")
        assert [one.rerun for one in found.disturbed] == ["iteration-003", "iteration-004"]
        assert all("stolen" in one.reasons[0] for one in found.disturbed)
        notes = found.requirements[0].notes
        assert any("interference" in note for note in notes) == (first == "fail")
        # The machine is said first, and alone: more starts would not help.
        assert (found.requirements[0].remedy == REMEDY) == (outcome == "inconclusive")

    @pytest.mark.parametrize("requirement", [ASKED, "latency.mean < 60 ms", "latency.max < 60 ms"])
    def test_what_no_disturbance_explains_stays_a_failure(self, requirement: str) -> None:
        busy = msgspec.structs.replace(QUIET, foreign_cores=4.0, pressure=1.0)
        samples = run({"hopeless": busy}, {"hopeless": busy})
        found = judged(samples, requirement)
        assert found.outcome == "fail"
        assert iterations_to_rerun(found) == []

    def test_a_monitor_that_received_nothing_fails_on_any_machine(self) -> None:
        segments = [Played(30, FAST, silent=("detections",))] * 2
        samples = Simulation(segments=segments).samples()
        assert judged(with_interference(samples, STOLEN)).outcome == "fail"

    def test_reruns_that_cannot_change_the_outcome_are_not_played(self) -> None:
        slo = {"slo": objective(ASKED)}
        twice = run({"fail": STOLEN}, {"fail": STOLEN}, {"fail": STOLEN})
        assert len(iterations_to_rerun(judge(slo, twice))) == 3
        hopeless = {**slo, "other": objective("latency.mean < 1 ms")}
        found = judge(hopeless, twice)
        assert [requirement.weakened for requirement in found.requirements] == [True, False]
        assert iterations_to_rerun(found) == []
        hint = {"slo": msgspec.structs.replace(objective(ASKED), level="warn")}
        assert iterations_to_rerun(judge(hint, twice)) == []

    def test_what_is_to_be_played_again(self) -> None:
        samples = run(
            {"fail": STOLEN},
            {"fail": QUIET},
            {"pass": STOLEN},
            again={0: ("pass", QUIET)},
        )
        found = judged(samples, "latency.max < 50 ms")
        # One undisturbed iteration is over the limit: nothing is to be gained.
        assert (found.outcome, iterations_to_rerun(found)) == ("fail", [])
        calm = run({"fail": STOLEN}, {"pass": QUIET}, {"pass": STOLEN})
        found = judged(calm, "latency.max < 50 ms")
        assert found.outcome == "inconclusive"
        assert [one.segment for one in iterations_to_rerun(found)] == [
            "iteration-001",
            "iteration-003",
        ]


class TestTheBestLight:
    @pytest.mark.parametrize(
        ("known", "share"),
        [
            (None, 0.0),
            (HostInterference(seconds=10.0), 0.0),
            (HostInterference(seconds=10.0, pressure=0.2, foreign_cores=1.5), 0.2),
            (HostInterference(seconds=10.0, foreign_cores=0.3), 0.3),
            (HostInterference(seconds=10.0, cores=4, steal=0.1, pressure=0.1), 0.5),
            (HostInterference(seconds=10.0, throttled_s=2.0), 0.2),
            (HostInterference(own_waited=0.1, pressure=0.4, foreign_cores=1.0), 0.1),
            # Beside another program, a hardware thread is at least half as fast.
            (BUSY, 0.4),
            (HostInterference(seconds=10.0, pressure=1.0), 0.75),
        ],
    )
    def test_for_how_long_it_was_kept_waiting(
        self, known: HostInterference | None, share: float
    ) -> None:
        assert taken_share(known) == pytest.approx(share)

    def test_the_faster_half_stands_for_all(self) -> None:
        latency = np.linspace(0.010, 0.0399, 300)
        latency[[5, 250]] = np.nan
        samples = Simulation(segments=[Played(30, latency)]).samples()
        (one,) = samples.iterations[30.0]
        best = best_case_iteration(
            replace(one, interference=HostInterference(seconds=10.0, pressure=0.5))
        )
        found = best.monitors["detections"]
        assert (found.answered, found.missed, found.sent) == (300, 0, 300)
        half = np.sort(latency)[:150] * 0.5
        assert np.sort(found.latency) == pytest.approx(np.repeat(half, 2), abs=2e-9)


@pytest.mark.parametrize("rate_hz", [10, 30, 100])
@pytest.mark.parametrize(
    "waited",
    [
        pytest.param(math.nan, id="not counted"),
        pytest.param(0.0, id="nothing waited"),
        pytest.param(0.005, id="hardly anything waited"),
    ],
)
def test_a_limit_that_even_the_best_case_breaks_fails_on_a_busy_host(
    tmp_path: Path, rate_hz: float, waited: float
) -> None:
    """Of 1,000 messages the fastest took 10 ms, while others used both cores."""
    latency = np.random.default_rng(3).uniform(0.010, 0.014, (10, 100))
    folder = Simulation(
        segments=[Played(rate_hz, row) for row in latency],
        objectives={"slo": objective("latency.p99 < 4 ms", at=f"{rate_hz} Hz")},
        interference={"busy_s": 1.9, "stolen_s": 0.0, "waited_s": 0.15, "throttled_s": 0.0},
        waited=waited,
    ).write(tmp_path / "run")
    found = api.judge(folder).verdict
    assert len(found.disturbed) == 10
    assert found.outcome == "fail"
    assert "The faster half of the messages" in found.requirements[0].notes[0]


def probe(rate_hz: float, *, holds: bool, explained: bool = False, busy: bool = True) -> Probe:
    return Probe(
        segment=f"p{rate_hz}",
        rate_hz=rate_hz,
        delivered_hz=rate_hz * 0.8,
        holds=holds,
        reason="said",
        disturbed=("other processes used 1.8 of 2 cores (limit 0.5)",) if busy else (),
        explained=explained,
    )


def judged_probes(policy: InterferencePolicy, asked: str, **record: object) -> RequirementVerdict:
    simulation = replace(Simulation(segments=[Played(30, FAST)]), **record)  # type: ignore[arg-type]
    (one,) = judged(simulation.samples(), asked, policy).requirements
    return one


@pytest.mark.parametrize(
    ("holds", "explained", "policy", "outcome"),
    [
        (True, False, "note", "pass"),
        (False, True, "note", "inconclusive"),
        (False, False, "note", "fail"),
        (False, False, "tolerate", "fail"),
        (True, False, "tolerate", "pass"),
    ],
)
def test_a_rate_that_was_probed_on_a_busy_machine(
    holds: bool, explained: bool, policy: InterferencePolicy, outcome: Outcome
) -> None:
    sustained = (probe(30.0, holds=holds, explained=explained),)
    one = judged_probes(policy, "sustained", sustained=sustained)
    assert one.outcome == outcome
    assert "Host interference during the probe at 30 Hz: other processes" in one.notes[0]


def test_a_peak_that_was_found_on_a_busy_machine() -> None:
    search = SearchRecord(
        probes=(probe(60.0, holds=True), probe(80.0, holds=False, explained=True)),
        holds_hz=60.0,
        fails_hz=None,
        limited_by="interference",
    )
    asked = "peak.rate >= 50 Hz"
    at_least = judged_probes("note", asked, search=search)
    assert (at_least.outcome, at_least.upper) == ("pass", None)
    assert "during the probes above it other processes used" in at_least.reason
    open_ = judged_probes("note", "peak.rate >= 90 Hz", search=search)
    assert (open_.outcome, open_.remedy) == ("inconclusive", REMEDY)
    # That it is below 90 Hz is not known: the failures may be the machine's.
    below = judged_probes("note", "peak.rate < 90 Hz", search=search)
    assert below.outcome == "inconclusive"
