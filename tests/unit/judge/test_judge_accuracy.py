"""Verdicts on accuracy: what differs from the truth fails; what was not compared never passes."""

from __future__ import annotations

from pathlib import Path

import msgspec
import numpy as np
import pytest

from r2bspec.judge.decision_policy import DecisionPolicy
from r2bspec.judge.judge_run import judge_with_confirmation
from r2bspec.judge.measure.samples import RunSamples
from r2bspec.judge.pipeline import judge
from r2bspec.judge.verdict import RequirementVerdict
from r2bspec.record.comparison_folder import merge_runs
from r2bspec.record.run_record import AccuracyRecord
from run_simulation import Played, Simulation, objective


def compared(**fields: object) -> AccuracyRecord:
    known = {
        "monitor": "detections",
        "kind": "tag",
        "of": "/image",
        "outputs": 6,
        "steps": 6,
        "values": {"accuracy.tag_missed": 0.5, "accuracy.tag_false": 0.0},
        "text": "The tag is visible in 6 images and found in 3.",
    }
    return AccuracyRecord(**(known | fields))  # type: ignore[arg-type]


def samples(*accuracy: AccuracyRecord, **fields: object) -> RunSamples:
    segments = fields.pop("segments", (Played(30, np.full(300, 0.02)),))
    return Simulation(segments=segments, accuracy=accuracy, **fields).samples()  # type: ignore[arg-type]


def verdicts(found: RunSamples, *requirements: str) -> tuple[RequirementVerdict, ...]:
    return judge({"slo": objective(*requirements, at="30 Hz")}, found).requirements


@pytest.mark.parametrize(
    ("requirement", "outcome"),
    [
        ("accuracy.tag_missed <= 50 %", "pass"),
        ("accuracy.tag_missed <= 49 %", "fail"),
        ("accuracy.tag_missed == 0 %", "fail"),
        ("accuracy.tag_false == 0 %", "pass"),
        ("detections.accuracy.tag_missed <= 10 %", "fail"),
    ],
)
def test_the_value_is_compared_with_the_limit(requirement: str, outcome: str) -> None:
    (found,) = verdicts(samples(compared()), requirement)
    assert (found.outcome, found.method) == (outcome, "comparison with truth")
    assert (found.monitor, found.n, found.unit) == ("detections", 6, "share")
    assert "found in 3" in found.reason
    assert "6 of 6 steps" in found.reason


def test_no_outputs_at_all_fail() -> None:
    nothing = compared(outputs=0, values={}, text="")
    (found,) = verdicts(samples(nothing), "accuracy.tag_missed <= 100 %")
    assert found.outcome == "fail"
    assert "0 of 6 steps were answered" in found.reason


def test_what_was_not_compared_never_passes() -> None:
    asked = "accuracy.disparity_bad_pixels <= 100 %"
    for accuracy in (
        (),
        (compared(),),
        (compared(kind="disparity", problem="It has no ground truth."),),
    ):
        (found,) = verdicts(samples(*accuracy), asked)
        assert found.outcome == "inconclusive"
        assert found.remedy


def test_each_monitor_with_that_truth_is_judged() -> None:
    both = (
        compared(monitor="left", values={"accuracy.tag_missed": 0.0}),
        compared(monitor="right"),
    )
    other = compared(monitor="disparity", kind="disparity", values={})
    run = samples(*both, other, monitors=("left", "right", "disparity"))
    found = verdicts(run, "accuracy.tag_missed <= 10 %")
    assert [(each.monitor, each.outcome) for each in found] == [("left", "pass"), ("right", "fail")]
    (one,) = verdicts(run, "left.accuracy.tag_missed <= 10 %")
    assert (one.monitor, one.outcome) == ("left", "pass")


def test_a_wrong_output_fails_the_run_without_a_second_run() -> None:
    asked = {"slo": objective("accuracy.tag_missed == 0 %", at="30 Hz")}
    run = samples(compared())
    found = judge_with_confirmation(asked, run, DecisionPolicy())
    assert found.outcome == "fail"
    assert "second run" not in found.reason


def test_a_second_run_that_passes_does_not_excuse_a_wrong_output() -> None:
    """The latency failed once and passed then; what was compared with the truth stays wrong."""
    from r2bspec.record.run_record import ConfirmationRecord

    run = samples(
        compared(),
        segments=(
            Played(30, np.full(300, 0.2)),
            Played(30, np.full(300, 0.02), kind="confirmation"),
        ),
        confirmation=ConfirmationRecord(search=None, sustained=(), harness_overhead=()),
    )
    asked = {"slo": objective("latency.p90 < 100 ms", "accuracy.tag_missed == 0 %", at="30 Hz")}
    found = judge_with_confirmation(asked, run, DecisionPolicy())
    assert [requirement.outcome for requirement in found.requirements] == ["inconclusive", "fail"]
    assert found.outcome == "fail"


def test_a_playback_that_missed_its_schedule_does_not_hide_a_wrong_output() -> None:
    late = Played(30, np.full(300, 0.02), late=np.full(300, 0.5))
    (found,) = verdicts(samples(compared(), segments=(late,)), "accuracy.tag_missed == 0 %")
    assert found.outcome == "fail"


def test_an_objective_needs_no_rate() -> None:
    asked = {"slo": objective("accuracy.tag_false == 0 %", at="")}
    (found,) = judge(asked, samples(compared())).requirements
    assert found.outcome == "pass"


def test_runs_that_are_merged_keep_what_was_compared(tmp_path: Path) -> None:
    """Those of a comparison, which compares base and head in pairs of runs."""
    runs = []
    for number in range(2):
        simulation = Simulation((Played(30, np.full(300, 0.02)),), accuracy=(compared(),))
        runs.append(simulation.write(tmp_path / str(number)))
    whole = msgspec.structs.replace(runs[0].record, accuracy=())
    merged = merge_runs(runs, folder=tmp_path, plan=runs[0].plan, whole=whole)
    assert merged.record.accuracy == (compared(),)
