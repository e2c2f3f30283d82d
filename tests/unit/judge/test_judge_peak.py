"""What a bracket decides that was not confirmed, is not steady, or is refuted by iterations."""

from __future__ import annotations

import msgspec
import numpy as np
import pytest

from r2bspec.judge.measure.samples import RunSamples
from r2bspec.judge.methods.peak_bracket import with_refuted_peak
from r2bspec.judge.pipeline import judge
from r2bspec.judge.verdict import RequirementVerdict
from r2bspec.record.run_record import SearchRecord
from r2bspec.report.wording import peak_text
from run_simulation import Played, Simulation, objective, probe

CONFIRMED = SearchRecord(
    probes=(probe(5, holds=True), probe(200, holds=False), probe(100, holds=True)),
    holds_hz=100.0,
    fails_hz=102.0,
    limited_by="graph",
    precision=0.02,
    confidence=0.95,
    proof="confirmed",
    proof_s=30.0,
    max_lost=0.01,
)


def changed(**changes: object) -> SearchRecord:
    return msgspec.structs.replace(CONFIRMED, **changes)


def samples_of(search: SearchRecord, *segments: Played) -> RunSamples:
    return Simulation(segments=segments, search=search).samples()


def ask(samples: RunSamples, requirement: str) -> RequirementVerdict:
    (found,) = judge({"one": objective(requirement, at="")}, samples).requirements
    return found


@pytest.mark.parametrize(
    ("requirement", "search", "outcome"),
    [
        ("peak.rate >= 100 Hz", CONFIRMED, "pass"),
        ("peak.rate >= 100 Hz", changed(proof="probes", proof_s=1.0), "pass"),
        ("peak.rate >= 10 Hz", changed(proof="open"), "inconclusive"),
        ("peak.rate >= 102 Hz", changed(proof="open"), "fail"),
        ("peak.rate >= 10 Hz", changed(refuted="it is"), "inconclusive"),
        ("peak.rate >= 102 Hz", changed(refuted="it is"), "fail"),
        (
            "peak.rate >= 90 Hz",
            changed(unsteady=("it drifts",), unsteady_ratio=1.2),
            "inconclusive",
        ),
        ("peak.rate >= 80 Hz", changed(unsteady=("it drifts",), unsteady_ratio=1.2), "pass"),
        (
            "peak.rate >= 110 Hz",
            changed(unsteady=("it drifts",), unsteady_ratio=1.2),
            "inconclusive",
        ),
        ("peak.rate >= 130 Hz", changed(unsteady=("it drifts",), unsteady_ratio=1.2), "fail"),
    ],
)
def test_what_is_doubted_decides_less(requirement: str, search: SearchRecord, outcome: str) -> None:
    found = ask(samples_of(search), requirement)
    assert found.outcome == outcome
    assert bool(found.remedy) == (outcome == "inconclusive")


@pytest.mark.parametrize(
    ("search", "words"),
    [
        (changed(proof="open"), "no rate was confirmed when it was played whole"),
        (
            changed(proof="probes", proof_s=1.5, lost_at_most=0.077),
            "only in probes of 1.5 s, at most 7.7 % lost",
        ),
        (changed(unsteady=("stops for 0.5 s about every 5 s",)), "not steady: stops for 0.5 s"),
        (changed(refuted="the iteration refutes it"), "the iteration refutes it"),
    ],
)
def test_reports_and_verdicts_say_what_is_missing_instead_of_a_confidence(
    search: SearchRecord, words: str
) -> None:
    assert words in peak_text(search)
    assert "confidence" not in peak_text(search)
    reason = ask(samples_of(search), "peak.rate >= 10 Hz").reason
    assert words in reason.lower()


def test_a_confidence_says_what_it_is_for() -> None:
    # Of what comes every T seconds, none is met in 3 T in one of twenty runs.
    assert changed(watched_s=90.0).recurs_s == pytest.approx(30.0, rel=2e-3)
    assert "95 % confidence of one start, for what recurs within 30 s" in peak_text(
        changed(watched_s=90.0)
    )
    assert changed(watched_s=90.0, confidence=0.0).recurs_s == 0.0
    assert "95 % confidence of one start, stops apart" in peak_text(changed(watched_s=0.0))


@pytest.mark.parametrize("requirement", ["peak.rate >= 95 Hz", "peak.rate <= 102 Hz"])
def test_a_verdict_has_the_confidence_of_its_bracket_and_no_note_that_all_have(
    requirement: str,
) -> None:
    found = ask(samples_of(changed(watched_s=90.0)), requirement)
    assert found.outcome == "pass"
    assert found.reason.endswith(
        "It has 95 % confidence of one start, for what recurs within 30 s."
    )
    assert found.notes == ()
    unsteady = changed(watched_s=90.0, unsteady=("it drifts",), unsteady_ratio=1.01)
    assert "confidence" not in ask(samples_of(unsteady), requirement).reason


def played(climb: float, *, lost: int = 0, seed: int = 0) -> Played:
    """An iteration at the peak, whose latency climbs by so many seconds per second."""
    random = np.random.default_rng(seed)
    latency = 0.02 + climb * np.arange(300) / 100 + random.normal(0, 0.001, 300)
    latency[random.choice(300, lost, replace=False)] = np.nan
    return Played(100, latency)


def test_iterations_that_are_sustained_refute_nothing() -> None:
    samples = samples_of(CONFIRMED, *(played(0.0, seed=seed) for seed in range(5)))
    assert with_refuted_peak(samples) is samples
    assert ask(samples, "peak.rate >= 100 Hz").outcome == "pass"


@pytest.mark.parametrize("number", [1, 5])
def test_a_backlog_that_grows_at_the_peak_refutes_it(number: int) -> None:
    iterations = (played(0.05, seed=seed) for seed in range(number))
    samples = samples_of(CONFIRMED, *iterations)
    search = with_refuted_peak(samples).record.search
    assert search is not None
    assert not search.shown
    assert search.refuted.endswith("the backlog grows by 4.76 messages/s") or number == 1
    assert "refute it: the backlog grows by" in search.refuted
    found = ask(samples, "peak.rate >= 100 Hz")
    assert found.outcome == "inconclusive"
    assert "refute it" in found.reason


@pytest.mark.parametrize(("lost", "refuted"), [(12, "60 of 1500 messages were lost"), (3, "")])
def test_losses_at_the_peak_refute_it(lost: int, refuted: str) -> None:
    lossy = (played(0.0, lost=lost, seed=seed) for seed in range(5))
    search = with_refuted_peak(samples_of(CONFIRMED, *lossy)).record.search
    assert search is not None
    assert search.refuted.endswith(refuted)
    assert bool(search.refuted) == bool(refuted)
