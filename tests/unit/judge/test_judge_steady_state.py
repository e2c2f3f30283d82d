"""A part of the iterations that differs from the rest."""

from __future__ import annotations

import re
from dataclasses import replace

import msgspec
import numpy as np
import pytest
from numpy.typing import NDArray

from r2bspec.judge.measure.samples import RunSamples
from r2bspec.judge.pipeline import judge
from r2bspec.judge.verdict import RequirementVerdict
from run_simulation import Played, Simulation, objective, segment_of, with_starts
from simulated_runs import RATE_HZ, run_of

PAIRS = (1, 1, 2, 2, 3, 3, 4, 4, 5, 5)
TWO = (1, 1, 1, 1, 1, 2, 2, 2, 2, 2)
ONE = (1,) * 10
MESSAGES = 75
FIRSTS = slice(None, None, 2)


def latencies(typical_s: float = 0.006) -> NDArray[np.float64]:
    """Ten iterations whose messages scatter by 5 %."""
    random = np.random.default_rng(2)
    return np.asarray(typical_s * random.normal(1, 0.05, (10, MESSAGES)))


def changed(part: slice, factor: float) -> NDArray[np.float64]:
    found = latencies()
    found[part] *= factor
    return found


def one(samples: RunSamples, requirement: str) -> RequirementVerdict:
    return judge({"slo": objective(requirement)}, samples).requirements[0]


@pytest.mark.parametrize("requirement", ["latency.mean < 20 ms", "latency.p99 < 50 ms"])
@pytest.mark.parametrize(
    ("part", "starts", "factor"),
    [
        (FIRSTS, PAIRS, 1.5),
        (FIRSTS, PAIRS, 0.8),
        (slice(1), ONE, 1.5),
        (slice(None, None, 5), TWO, 1.5),
    ],
)
def test_first_iterations_that_differ_are_noted(
    part: slice, starts: tuple[int, ...], factor: float, requirement: str
) -> None:
    found = one(run_of(changed(part, factor), starts), requirement)
    assert found.outcome == "pass"
    said = re.match(
        r"In the first iteration of each start, the latency was ([\d.]+) times that of the later",
        found.notes[-1],
    )
    assert said, found.notes
    assert float(said[1]) == pytest.approx(factor, rel=0.03)


@pytest.mark.parametrize("starts", [TWO, ONE])
def test_a_climb_within_starts_is_noted_and_no_warm_up(starts: tuple[int, ...]) -> None:
    each = 10 // len(set(starts))
    climb = np.tile(np.linspace(1.0, 1.27, each * MESSAGES), 10 // each).reshape(10, MESSAGES)
    found = one(run_of(latencies() * climb, starts), "latency.mean < 20 ms")
    assert found.outcome == "pass"
    assert "At the end of each start, the latency was 1." in found.notes[-1]
    assert "look for what changes" in found.notes[-1]
    assert "warm_up" not in found.notes[-1]


@pytest.mark.parametrize("starts", [PAIRS, TWO, ONE])
def test_iterations_that_are_alike_need_no_word(starts: tuple[int, ...]) -> None:
    found = one(run_of(latencies(), starts), "latency.mean < 20 ms")
    assert not any(" times that " in note for note in found.notes)


@pytest.mark.parametrize(
    ("starts", "part", "advice"),
    [
        (TWO, slice(None, None, 5), "With 'warm_up: 4 s' it is not counted."),
        (
            PAIRS,
            FIRSTS,
            (
                "Three iterations in each start would show whether it is a warm-up, "
                "which 'warm_up: 4 s' leaves out, or goes on."
            ),
        ),
    ],
)
def test_the_figures_and_the_way_out(starts: tuple[int, ...], part: slice, advice: str) -> None:
    samples = run_of(changed(part, 1.5), starts)
    warm_up = msgspec.structs.replace(segment_of(RATE_HZ, 45), kind="warm_up")
    record = msgspec.structs.replace(samples.record, segments=(warm_up, *samples.record.segments))
    said = one(replace(samples, record=record), "latency.mean < 20 ms").notes[-1]
    # A warm-up of 1.5 s, and an iteration of 2.5 s.
    assert re.fullmatch(
        r"In the first iteration of each start, the latency was 1\.\d+ times that of the later "
        r"ones \(8\.\d+ ms against 5\.\d+ ms without the slowest tenth\)\. " + re.escape(advice),
        said,
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
    assert one(run_of(shuffled, PAIRS), limit).outcome == whole
    found = one(run_of(played, PAIRS), limit)
    assert found.outcome == "inconclusive"
    assert "warm_up" in found.notes[-1] + found.remedy
    assert not found.weakened


def test_throughput_is_compared_by_intervals() -> None:
    service_s = latencies(0.04)
    service_s[FIRSTS] *= 1.5
    overloaded = np.cumsum(service_s, axis=1) - np.arange(MESSAGES) / RATE_HZ
    found = one(run_of(overloaded, PAIRS), "throughput.mean >= 12 Hz")
    assert "the interval between outputs was 1.5" in found.notes[-1]


@pytest.mark.parametrize("cpu", [0.5, 0.0])
def test_means_that_belong_to_no_monitor(cpu: float) -> None:
    segments = [Played(RATE_HZ, row) for row in latencies()]
    samples = with_starts(Simulation(segments, cpu={"relay": cpu}).samples(), PAIRS)
    found = one(samples, "cpu.relay.mean < 90 %")
    assert found.outcome == "pass"
    assert not any(" times that " in note for note in found.notes)
