"""Outputs that come whether inputs do or not: what is known of them, and how one sees it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

import msgspec
import numpy as np
import pytest

from r2bspec.judge.measure.matching import NO_MATCH, match_monitor
from r2bspec.judge.measure.metric_declarations import DECLARED
from r2bspec.judge.measure.own_pace import PaceEvidence, fitting_match, own_pace_text, own_period_s
from r2bspec.judge.measure.sample_table import MonitorSamples, monitor_samples
from r2bspec.language.spec_benchmark import Match
from r2bspec.record.run_record import Segment
from r2bspec.record.sample_arrays import MONITOR_DTYPE
from run_simulation import MONITOR_PLAN, Played, playback_rows

INPUT_HZ = 30.0
STEPS = 60
FOREIGN = 5


def received(
    times_s: Sequence[float],
    stamps: Literal["newest", "own"] = "newest",
    by: Match = "stamp",
    before: int = 0,
) -> tuple[float | None, MonitorSamples]:
    """Messages at times after the first step; with the newest step's stamp, or another."""
    playback = playback_rows(Played(INPUT_HZ, [float("nan")] * STEPS))
    began_ns = int(playback["published_ns"][0])
    rows = np.zeros(len(times_s), MONITOR_DTYPE)
    rows["received_ns"] = rows["taken_ns"] = began_ns + np.round(np.array(times_s) * 1e9)
    newest = np.searchsorted(playback["published_ns"], rows["received_ns"], side="right") - 1
    rows["stamp_ns"] = np.where(newest < 0, FOREIGN, playback["stamp_ns"][newest])
    if stamps == "own":
        rows["stamp_ns"] = FOREIGN + np.arange(rows.size)
    segment = Segment(
        id="rate-30Hz-001",
        kind="iteration",
        index=1,
        rate_hz=INPUT_HZ,
        steps=STEPS,
        began_ns=began_ns,
        ended_ns=began_ns + round(STEPS / INPUT_HZ * 1e9),
        complete=True,
        played_before=before,
    )
    plan = msgspec.structs.replace(MONITOR_PLAN, match=by)
    matched = match_monitor(playback, rows, plan)
    seen = monitor_samples(segment, matched)
    return seen.own_period_s, seen


def ticks(hz: float, until_s: float = 2.4) -> list[float]:
    return [0.01 + number / hz for number in range(int((until_s - 0.01) * hz) + 1)]


@pytest.mark.parametrize("stamps", ["newest", "own"])
@pytest.mark.parametrize("hz", [10.0, 100.0])
def test_a_timer_is_recognised_slower_and_faster_than_the_inputs(
    hz: float, stamps: Literal["newest", "own"]
) -> None:
    assert received(ticks(hz), stamps)[0] == pytest.approx(1 / hz)


def test_by_order_one_message_before_the_inputs_is_enough() -> None:
    assert received([-0.09, *ticks(10.0)], by="order")[0] == pytest.approx(0.1)
    assert received(ticks(10.0, 2.0), by="order")[0] is None


@pytest.mark.parametrize(
    "times_s",
    [
        [0.01 + step / INPUT_HZ for step in range(STEPS)],
        # Overloaded: each message answers a step of its own, and none comes unasked.
        ticks(10.0, 2.0),
        # Three outputs at once for each input.
        [0.001 * output + step / INPUT_HZ for step in range(STEPS) for output in range(3)],
        ticks(10.0, 0.3),
        [],
    ],
    ids=["follows", "overloaded", "bursts", "few", "none"],
)
def test_what_follows_the_inputs_is_no_timer(times_s: list[float]) -> None:
    assert received(times_s)[0] is None


def test_the_inputs_period_is_nothing_of_its_own() -> None:
    assert received([0.01 + step / INPUT_HZ for step in range(STEPS)], "own")[0] is None


def evidence(period_s: float, intervals: int = 9, unasked: int = 2) -> PaceEvidence:
    at_ns = np.full(intervals, round(period_s * 1e9))
    return PaceEvidence(at_ns, unasked, least=2, step_ns=1e9 / INPUT_HZ)


def test_a_slow_timer_is_recognised_over_segments() -> None:
    slow = evidence(1.0, intervals=2, unasked=1)
    assert own_period_s([slow]) is None
    assert own_period_s([slow, slow]) == pytest.approx(1.0)
    # Late answers of an overloaded node are unasked for only in the segment in which they come.
    assert own_period_s([slow, slow], overdue=1) is None
    assert own_period_s([slow, slow, evidence(1 / INPUT_HZ)]) is None
    parts = [received([0.4, 1.4, 2.4], "own")[1] for _ in range(2)]
    assert parts[0].own_period_s is None
    assert MonitorSamples.joined(parts).own_period_s == pytest.approx(1.0)


def test_what_is_played_decides_the_age_and_no_message_is_missed() -> None:
    _, seen = received(ticks(10.0), by="own_pace")
    # Those after the window, and what the drain heard, do not count.
    assert seen.received == 20
    assert seen.throughput_hz == pytest.approx(10.0)
    assert seen.own_pace
    assert seen.missed == seen.duplicates == seen.unmatched == 0
    assert seen.age.size == 20
    assert seen.age.min() >= 0
    assert seen.age.max() < 1 / INPUT_HZ
    assert seen.jitter.max() < 1e-6
    assert not seen.latency.size


def test_the_age_is_unknown_where_stamps_are_of_no_input() -> None:
    _, seen = received(ticks(10.0), "own", by="own_pace")
    assert seen.received == 20
    assert not seen.age.size
    assert (seen.outputs["newest_ns"] == NO_MATCH).all()


@pytest.mark.parametrize(
    ("period_s", "ratio"),
    [
        (0.1, "'ratio: {inputs: 3}'"),
        (1 / 90, "'ratio: {outputs: 3}'"),
        (0.08, "interval or jitter."),
    ],
)
def test_a_ratio_is_proposed_where_one_fits(period_s: float, ratio: str) -> None:
    assert ratio in own_pace_text(period_s, 1 / INPUT_HZ)
    assert "ratio" not in own_pace_text(period_s)


def after_inputs(outputs: Sequence[int], delay_s: float = 0.01) -> list[float]:
    """So many outputs of each input, the first after a delay."""
    return [
        delay_s + step / INPUT_HZ + 0.001 * number
        for step, count in enumerate(outputs)
        for number in range(count)
    ]


DETECTIONS = ([0, 2, 1, 0, 1, 2, 1, 1] * STEPS)[:STEPS]
"""0, 1 or 2 outputs of an input."""


@pytest.mark.parametrize("inputs", [2, 3, 7, 15])
def test_an_output_of_every_nth_input_is_a_ratio(inputs: int) -> None:
    times = after_inputs([step % inputs == 0 for step in range(STEPS)])
    assert f"'ratio: {{inputs: {inputs}}}'" in received(times)[1].fitting_match


def test_as_many_outputs_of_each_input_are_a_ratio() -> None:
    fitting = received(after_inputs([3] * STEPS))[1].fitting_match
    assert "'ratio: {outputs: 3}'" in fitting


def test_a_ratio_may_have_both_sides() -> None:
    times = after_inputs([2 * (step % 5 == 4) for step in range(STEPS)])
    assert "'ratio: {inputs: 5, outputs: 2}'" in received(times)[1].fitting_match


@pytest.mark.parametrize(
    "times_s",
    [
        after_inputs([1] * STEPS),
        after_inputs([(step * step) % 7 != 2 for step in range(STEPS)]),
        [],
    ],
    ids=["one each", "losses", "none"],
)
def test_losses_are_no_ratio(times_s: list[float]) -> None:
    assert not received(times_s)[1].fitting_match


def test_an_overloaded_node_that_answers_every_third_input_has_no_ratio() -> None:
    strides, counts = np.full(9, 3.0), np.ones(10)
    assert "inputs: 3" in fitting_match(strides, counts, delay=0.5)
    assert not fitting_match(strides, counts, delay=2.7)


def test_0_to_2_outputs_of_an_input_are_any_number() -> None:
    assert "'match: any'" in received(after_inputs(DETECTIONS))[1].fitting_match


def test_of_any_number_each_output_has_a_latency_and_none_is_missed() -> None:
    _, seen = received([*after_inputs(DETECTIONS), 2.3], by="any")
    count = sum(DETECTIONS)
    assert seen.latency.size == seen.received - seen.unmatched
    assert seen.latency[:count].min() == pytest.approx(0.01)
    assert seen.throughput_hz == pytest.approx(count / (STEPS / INPUT_HZ), rel=0.05)
    unknown = {each.name for each in DECLARED if each.scope == "monitor" and not seen.knows(each)}
    assert unknown >= {"missed", "drop_rate", "duplicates"}
    assert seen.sent == STEPS
