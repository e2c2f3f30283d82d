"""A part of the iterations that differs from the rest, and processors that change frequency."""

from __future__ import annotations

import re
from dataclasses import replace

import msgspec
import numpy as np
import pytest
from numpy.typing import NDArray

from r2bspec.judge.caveats import particular_caveats
from r2bspec.judge.measure.host_usage import HostInterference
from r2bspec.judge.measure.metric_values import later_part
from r2bspec.judge.measure.samples import RunSamples
from r2bspec.judge.pipeline import judge
from r2bspec.judge.verdict import RequirementVerdict
from run_simulation import Played, Simulation, objective, segment_of, with_starts
from simulated_runs import RATE_HZ, run_of

Part = tuple[int | slice, ...]

STARTS = (1, 1, 2, 2, 3, 3, 4, 4, 5, 5)
MESSAGES = 75


def latencies(typical_s: float = 0.006, messages: int = MESSAGES) -> NDArray[np.float64]:
    """Ten iterations whose messages scatter by 5 %."""
    random = np.random.default_rng(2)
    return np.asarray(typical_s * random.normal(1, 0.05, (len(STARTS), messages)))


def changed(part: Part, factor: float) -> NDArray[np.float64]:
    found = latencies()
    found[part] *= factor
    return found


FIRST: Part = (0,)
FIRSTS: Part = (slice(None, None, 2),)
FIRST_START: Part = (slice(2),)
OPENING: Part = (slice(None), slice(15))
HALF: Part = (slice(None), slice(MESSAGES // 2))


def one(samples: RunSamples, requirement: str) -> RequirementVerdict:
    return judge({"slo": objective(requirement)}, samples).requirements[0]


def ratio_said(note: str, subject: str) -> float:
    found = re.match(rf"{subject} was ([\d.]+) times that", note)
    assert found, note
    return float(found[1])


def test_iterations_that_all_began_at_once_have_no_drift() -> None:
    """As a damaged record may say."""
    run = run_of(changed((slice(5, None),), 1.5))
    (rate,) = run.iterations
    at_once = [
        replace(each, segment=msgspec.structs.replace(each.segment, began_ns=0, ended_ns=10**9))
        for each in run.iterations[rate]
    ]
    same = replace(run, iterations={rate: tuple(at_once)})
    assert one(same, "latency.mean < 20 ms").outcome in {"pass", "inconclusive"}


@pytest.mark.parametrize("requirement", ["latency.mean < 20 ms", "latency.p99 < 50 ms"])
@pytest.mark.parametrize(
    ("part", "factor", "where"),
    [
        (FIRSTS, 1.5, "In the first iteration of each start"),
        (FIRST, 1.5, "In the first iteration"),
        (FIRST_START, 1.5, "In the first start"),
        (FIRSTS, 0.8, "In the first iteration of each start"),
        (OPENING, 2.0, "In the first 500 ms of each iteration"),
        (HALF, 1.2, "In the first half of each iteration"),
    ],
)
def test_a_part_that_differs_is_noted(
    part: Part, factor: float, where: str, requirement: str
) -> None:
    found = one(run_of(changed(part, factor), STARTS), requirement)
    assert found.outcome == "pass"
    assert ratio_said(found.notes[-1], f"{where}, the latency") == pytest.approx(factor, rel=0.03)


@pytest.mark.parametrize("starts", [STARTS, (1,) * 10])
def test_a_climb_is_noted(starts: tuple[int, ...]) -> None:
    climb = np.linspace(1.0, 1.3, 10 * MESSAGES).reshape(10, MESSAGES)
    found = one(run_of(latencies() * climb, starts), "latency.mean < 20 ms")
    assert found.outcome == "pass"
    assert "At the end of the run, the latency was 1.2" in found.notes[-1]
    assert "look for what changes" in found.notes[-1]


@pytest.mark.parametrize("starts", [STARTS, (1,) * 10])
def test_iterations_that_are_alike_need_no_word(starts: tuple[int, ...]) -> None:
    found = one(run_of(latencies(), starts), "latency.mean < 20 ms")
    assert not any(" times that " in note for note in found.notes)


def test_the_figures_and_the_way_out() -> None:
    samples = run_of(changed(FIRSTS, 1.5), STARTS)
    warm_up = msgspec.structs.replace(segment_of(RATE_HZ, 45), kind="warm_up")
    record = msgspec.structs.replace(samples.record, segments=(warm_up, *samples.record.segments))
    (said,) = (
        note
        for note in one(replace(samples, record=record), "latency.mean < 20 ms").notes
        if "first iteration" in note
    )
    # A warm-up of 1.5 s, and an iteration of 2.5 s.
    assert said == (
        "In the first iteration of each start, the latency was 1.51 times that of the later ones "
        "(8.91 ms against 5.92 ms without the slowest tenth). With 'warm_up: 4 s' it is not "
        "counted."
    )


@pytest.mark.parametrize(
    ("factor", "limit", "whole"),
    [
        # All together pass by the fast part, or fail by the slow part.
        (0.6, "latency.p50 < 5.9 ms", "pass"),
        (1.8, "latency.p90 < 7.5 ms", "fail"),
    ],
)
def test_a_verdict_that_rests_on_the_part_is_open(factor: float, limit: str, whole: str) -> None:
    played = changed(FIRSTS, factor)
    shuffled = np.random.default_rng(4).permutation(played.ravel()).reshape(played.shape)
    assert one(run_of(shuffled, STARTS), limit).outcome == whole
    found = one(run_of(played, STARTS), limit)
    assert found.outcome == "inconclusive"
    assert "warm_up" in found.remedy


def test_a_verdict_that_the_part_decides_against_the_rest_is_open() -> None:
    found = one(run_of(changed(OPENING, 3.0), STARTS), "latency.p90 < 9 ms")
    assert found.outcome == "inconclusive"
    assert found.notes[-1].endswith("Without that part, the requirement would be met.")
    assert found.remedy.startswith("Make iterations longer")
    assert not found.weakened


def test_fewer_messages_alone_open_nothing() -> None:
    slow = latencies(messages=MESSAGES)[:4]
    slow[:, :15] *= 2.0
    found = one(run_of(slow), "latency.p99 < 50 ms")
    assert found.outcome == "pass"
    without = run_of(slow[:, 15:])
    assert one(without, "latency.p99 < 50 ms").outcome == "inconclusive"


def overloaded(service_s: NDArray[np.float64]) -> NDArray[np.float64]:
    """Latencies of a server that needs longer than a period."""
    return np.cumsum(service_s, axis=1) - np.arange(service_s.shape[1]) / RATE_HZ


@pytest.mark.parametrize(
    ("part", "where"),
    [
        (FIRSTS, "In the first iteration of each start"),
        ((slice(None), slice(8)), "In the first 500 ms of each iteration"),
    ],
)
def test_throughput_is_compared_by_intervals(part: Part, where: str) -> None:
    service_s = latencies(0.04)
    service_s[part] *= 1.5
    found = one(run_of(overloaded(service_s), STARTS), "throughput.mean >= 12 Hz")
    subject = f"{where}, the interval between outputs"
    assert ratio_said(found.notes[-1], subject) == pytest.approx(1.5, rel=0.03)


def test_what_is_recorded_is_not_divided() -> None:
    """A recording begins with the same messages each time, which may be the slow ones."""
    samples = run_of(changed(OPENING, 2.0), STARTS)
    iterations = tuple(
        replace(each, segment=msgspec.structs.replace(each.segment, rate_hz=0.0))
        for each in samples.iterations[RATE_HZ]
    )
    recorded = replace(samples, iterations={0.0: iterations}, mode="timeline")
    (found,) = judge({"slo": objective("latency.mean < 20 ms", at="")}, recorded).requirements
    assert found.outcome == "pass"
    assert not any("of each iteration" in note for note in found.notes)


def test_lost_outputs_belong_to_the_part_in_which_they_were_due() -> None:
    lost = np.full(MESSAGES, 0.006)
    lost[[3, 40]] = np.nan
    (iteration,) = run_of([lost]).iterations[RATE_HZ]
    seen = later_part(iteration, 0.5).monitors["detections"]
    assert (seen.expected, seen.missed, seen.sent) == (60, 1, 60)
    assert seen.throughput_hz == pytest.approx(RATE_HZ * 59 / 60)


@pytest.mark.parametrize("cpu", [0.5, 0.0])
def test_means_that_belong_to_no_monitor(cpu: float) -> None:
    segments = [Played(RATE_HZ, row) for row in latencies()]
    samples = with_starts(Simulation(segments, cpu={"relay": cpu}).samples(), STARTS)
    found = one(samples, "cpu.relay.mean < 90 %")
    assert found.outcome == "pass"
    assert not any(" times that " in note for note in found.notes)


def frequencies(*ghz: float | None) -> RunSamples:
    around = [HostInterference(frequency_hz=each and each * 1e9) for each in ghz]
    return run_of(latencies(), STARTS, interference=around)


def test_a_frequency_that_moved_is_a_caveat_of_this_run() -> None:
    samples = frequencies(3.4, 3.4, None, 2.6, 3.0)
    verdict = judge({"slo": objective("latency.mean < 20 ms")}, samples)
    (said,) = particular_caveats(verdict.limits)
    assert said == (
        "The processors ran at 3.4 GHz in iteration-001, and at 2.6 GHz in iteration-004, which "
        "can make latencies 31 % longer: set their governor to 'performance'."
    )
    fixed = msgspec.structs.replace(samples.record, machine={"cpu_governor": "performance"})
    verdict = judge({"slo": objective("latency.mean < 20 ms")}, replace(samples, record=fixed))
    assert "or switch turbo off" in verdict.limits[-1]


@pytest.mark.parametrize("ghz", [(3.0, 3.1, 2.96), (None, None), (None, 3.0)])
def test_a_frequency_that_is_steady_or_unknown_is_not_mentioned(ghz: tuple[float | None]) -> None:
    verdict = judge({"slo": objective("latency.mean < 20 ms")}, frequencies(*ghz))
    assert not particular_caveats(verdict.limits)
