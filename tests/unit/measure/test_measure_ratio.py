"""Many to one and one to many: what is expected, counted, timed and judged."""

from __future__ import annotations

import msgspec
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from r2bspec.judge.measure.matching import StepRatio, match
from r2bspec.judge.pipeline import judge
from r2bspec.judge.rate_decision import Criterion, estimate_probe, judge_final, plan_interim_looks
from r2bspec.plan.plan import Plan
from r2bspec.record.sample_arrays import MONITOR_DTYPE, Rows
from run_simulation import EPOCH_NS, Played, Simulation, objective, playback_rows, samples_of


def played(steps: int, rate_hz: float = 10.0) -> Rows:
    return playback_rows(Played(rate_hz, np.zeros(steps)))


def received(times_s: list[float]) -> Rows:
    rows = np.zeros(len(times_s), MONITOR_DTYPE)
    rows["received_ns"] = EPOCH_NS + np.round(np.array(times_s) * 1e9).astype(np.int64)
    return rows


@pytest.mark.parametrize(
    ("ratio", "asked"),
    [
        (StepRatio(), [0, 1, 2, 3, 4, 5, 6]),
        (StepRatio(inputs=3), [2, 5]),
        (StepRatio(inputs=3, before=10), [1, 4]),  # of steps 9 to 11, the last two are here
        (StepRatio(inputs=3, before=12), [2, 5]),
        (StepRatio(inputs=3, outputs=2, before=2), [0, 0, 3, 3, 6, 6]),
        (StepRatio(outputs=2), [0, 0, 1, 1, 2, 2, 3, 3, 4, 4, 5, 5, 6, 6]),
        (StepRatio(inputs=8), []),
    ],
)
def test_answers_are_expected_after_the_last_step_of_each_group(
    ratio: StepRatio, asked: list[int]
) -> None:
    assert ratio.trigger_steps(7).tolist() == asked


@pytest.mark.parametrize(
    ("ratio", "steps", "times_s", "latency_s"),
    [
        # Steps at 0.0, 0.1, ..., 0.5: latency counts from the last step that an answer needs.
        (StepRatio(inputs=3), 6, [0.23, 0.54], [0.03, 0.04]),
        (StepRatio(outputs=2), 2, [0.01, 0.02, 0.11, 0.13], [0.01, 0.02, 0.01, 0.03]),
    ],
)
def test_each_answer_has_its_own_latency(
    ratio: StepRatio, steps: int, times_s: list[float], latency_s: list[float]
) -> None:
    playback, monitor = played(steps), received(times_s)
    matching = match(playback, monitor, "order", ratio)
    assert samples_of(playback, monitor, matching).latency == pytest.approx(latency_s)


@pytest.mark.parametrize(
    ("times_s", "missed", "unmatched", "early"),
    [
        ([0.2, 0.5, 0.51], 0, 1, 0),
        ([0.2], 1, 0, 0),
        # Answers before their step show that the counting is wrong.
        ([0.05, 0.35], 0, 0, 2),
    ],
)
def test_what_is_beyond_the_ratio_or_short_of_it_is_counted(
    times_s: list[float], missed: int, unmatched: int, early: int
) -> None:
    matching = match(played(6), received(times_s), "order", StepRatio(inputs=3))
    counts = (matching.missed, matching.unmatched, matching.early)
    assert counts == (missed, unmatched, early)


@pytest.mark.parametrize(("inputs", "outputs"), [(1, 1), (3, 1), (1, 3), (3, 2)])
@pytest.mark.parametrize("share", [1.0, 0.8])
def test_a_probe_holds_if_the_graph_keeps_up_whatever_the_ratio(
    inputs: int, outputs: int, share: float
) -> None:
    # With a share of 0.8 the graph needs a quarter longer for each step than there is.
    playback, ratio = played(600, 100.0), StepRatio(inputs, outputs)
    asked = ratio.trigger_steps(600)
    rng = np.random.default_rng(1)
    times = asked / 100.0 / share + 0.005 + rng.normal(0, 1e-4, asked.size)
    monitor = received(np.sort(times).tolist())
    monitor = monitor[monitor["received_ns"] < EPOCH_NS + 6 * 10**9]
    matching = match(playback, monitor, "order", ratio)
    seen = estimate_probe(100.0, playback, monitor, matching, EPOCH_NS + 6 * 10**9)
    found = seen.overall
    assert found.completed_hz == pytest.approx(100.0 * share, rel=0.01)
    assert found.delivered_hz == pytest.approx(100.0 * share, rel=0.01)
    judged = judge_final(seen, Criterion(precision=0.05), plan_interim_looks(6.0)[-1], None)
    assert judged.keeps_up is (share == 1.0)
    # 134 outputs without a loss do not show that at most 2.5 % are lost; 400 do.
    shown = True if seen.dropped.size > 200 else None
    assert judged.holds is (shown if share == 1.0 else False)


class _Ratioed(Simulation):
    """A simulation whose monitor gets one message for three steps; of those, one is lost."""

    def plan(self) -> Plan:
        plan = super().plan()
        (monitor,) = plan.monitors
        return msgspec.structs.replace(
            plan, monitors=(msgspec.structs.replace(monitor, ratio_inputs=3),)
        )


def _thirds(steps: int) -> list[float]:
    return [0.02 if step % 3 == 2 else np.nan for step in range(steps)]


def test_a_run_with_a_ratio_counts_in_answers_and_is_offered_a_third() -> None:
    samples = _Ratioed(segments=[Played(30, _thirds(90))] * 2, match="order").samples()
    seen = samples.iterations[30][0].monitors["detections"]
    assert (seen.sent, seen.expected, seen.answered, seen.missed) == (
        90,
        30,
        30,
        0,
    )
    assert seen.throughput_hz == pytest.approx(10)
    assert seen.latency == pytest.approx(np.full(30, 0.02))
    asked = {"all": objective("throughput.mean >= 97 % of offered", "missed == 0")}
    assert [requirement.outcome for requirement in judge(asked, samples).requirements] == [
        "pass",
        "pass",
    ]


def with_stamps_of(playback: Rows, steps: list[int], *, late_s: float = 0.01) -> Rows:
    """Outputs that have the stamps of these steps, in this order."""
    rows = np.zeros(len(steps), MONITOR_DTYPE)
    rows["stamp_ns"] = playback["stamp_ns"][steps]
    rows["received_ns"] = playback["published_ns"][steps] + round(late_s * 1e9)
    return rows


@pytest.mark.parametrize(
    ("steps", "ratio", "outputs", "triggers", "missed", "duplicates"),
    [
        # An output of several steps has the latency of the one whose stamp it has.
        (9, StepRatio(inputs=3), [0, 4, 8], [0, 4, 8], 0, 0),
        # Steps that nothing was asked of are not missed.
        (12, StepRatio(inputs=3), [1, 7, 10], None, 1, 0),
        # 30 Hz in, a timer of 10 Hz whose period is now three steps, now two or four.
        (15, StepRatio(inputs=3), [2, 5, 9, 11, 13], None, 0, 0),
        (6, StepRatio(inputs=3), list(range(6)), None, 0, 4),
        (3, StepRatio(outputs=2), [0, 0, 1, 2, 2, 2], [0, 0, 1, 1, 2, 2], 1, 1),
    ],
)
def test_by_stamp_a_group_of_steps_expects_its_outputs(
    steps: int,
    ratio: StepRatio,
    outputs: list[int],
    triggers: list[int] | None,
    missed: int,
    duplicates: int,
) -> None:
    playback = played(steps)
    monitor = with_stamps_of(playback, outputs)
    matching = match(playback, monitor, "stamp", ratio)
    assert (matching.missed, matching.duplicates, matching.unmatched) == (missed, duplicates, 0)
    assert triggers is None or matching.trigger_steps.tolist() == triggers
    latency = samples_of(playback, monitor, matching).latency
    assert latency == pytest.approx([0.01] * (len(outputs) - duplicates))


@given(
    steps=st.integers(0, 40),
    outputs=st.lists(st.integers(0, 39), max_size=60),
    ratio=st.builds(StepRatio, inputs=st.integers(1, 5), outputs=st.integers(1, 3)),
)
def test_by_stamp_every_message_is_counted_once(
    steps: int, outputs: list[int], ratio: StepRatio
) -> None:
    playback = played(steps)
    monitor = with_stamps_of(playback, [output for output in outputs if output < steps])
    found = match(playback, monitor, "stamp", ratio)
    answered = int(found.answered.sum())
    assert answered + found.duplicates + found.unmatched == monitor.size
    assert answered + found.missed == found.trigger_steps.size
    assert (np.diff(found.trigger_steps) >= 0).all()
    # An answered output is placed at the step whose stamp it has.
    rows = found.first_row[found.answered]
    assert (
        monitor["stamp_ns"][rows] == playback["stamp_ns"][found.trigger_steps[found.answered]]
    ).all()
