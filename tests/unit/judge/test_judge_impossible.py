"""What cannot be is INVALID with a sentence that says what, and what is unknown is not judged."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import msgspec
import numpy as np
import pytest
from numpy.typing import NDArray

from r2bspec.compare.report_input import ReportInput
from r2bspec.judge.decision_policy import decision_policy
from r2bspec.judge.judge_run import result_of
from r2bspec.judge.measure.metrics import summarise
from r2bspec.judge.measure.run_samples import read_samples
from r2bspec.judge.pipeline import judge
from r2bspec.judge.requirement_case import RequirementCase
from r2bspec.judge.result import Result
from r2bspec.judge.verdict import RequirementVerdict, Verdict
from r2bspec.plan.plan import Plan
from r2bspec.record.run_folder import Run, RunFolder, open_run
from r2bspec.record.sample_arrays import Rows
from r2bspec.report.data_formats import expected_answers
from r2bspec.report.format_registry import FORMATS, renderer
from r2bspec.report.notes import notes
from run_simulation import Played, Simulation, objective

STEPS = 300


@dataclass(frozen=True)
class Ratioed(Simulation):
    """A simulation with a ratio at its monitors."""

    inputs: int = 1
    outputs: int = 1

    def plan(self) -> Plan:
        plan = super().plan()
        monitors = tuple(
            msgspec.structs.replace(monitor, ratio_inputs=self.inputs, ratio_outputs=self.outputs)
            for monitor in plan.monitors
        )
        return msgspec.structs.replace(plan, monitors=monitors)


def by_order(*required: str, latency: NDArray[np.float64], iterations: int = 3) -> Ratioed:
    return Ratioed(
        segments=[Played(30, latency)] * iterations,
        objectives={"all": objective(*required)},
        match="order",
    )


def rewrite(run: Run, change: Callable[[Rows, Rows], Rows]) -> Run:
    """The run with other rows of its monitor, given those of playback and monitor."""
    folder = RunFolder(run.folder)
    for segment in run.record.segments:
        rows = change(run.playback(segment), run.monitor(segment, "detections"))
        folder.write_rows("monitor", rows, segment.id, "detections")
    folder.write_record(run.record)
    return open_run(run.folder)


def verdict_of(run: Run) -> Verdict:
    return judge(run.plan.objectives, read_samples(run))


def doubled(_: Rows, rows: Rows) -> Rows:
    return np.sort(np.repeat(rows, 2), order="received_ns")


def doubled_and_dropped(_: Rows, rows: Rows) -> Rows:
    """Every second step answered twice, the others not at all."""
    return np.sort(np.concatenate((rows[::2], rows[::2])), order="received_ns")


def earlier(by_s: float, share: float = 1.0) -> Callable[[Rows, Rows], Rows]:
    def change(_: Rows, rows: Rows) -> Rows:
        changed = rows.copy()
        changed["received_ns"][: round(share * rows.size)] -= round(by_s * 1e9)
        return np.sort(changed, order="received_ns")

    return change


def by_stamp(folder: Path, *required: str, steps: int = STEPS, iterations: int = 3) -> Run:
    """A run whose outputs take 20 ms each."""
    return Simulation(
        segments=[Played(30, np.full(steps, 0.02))] * iterations,
        objectives={"all": objective(*required)},
    ).write(folder / "run")


def test_answers_before_their_question_are_invalid(tmp_path: Path) -> None:
    run = by_stamp(tmp_path, "latency.p99 < 50 ms", "drop_rate <= 1 %")
    found = verdict_of(rewrite(run, earlier(0.12)))
    assert (found.outcome, found.exit_code) == ("invalid", 4)
    assert "900 of 900 outputs were received before their input was published" in found.reason
    assert "impossible" in found.reason
    assert {requirement.outcome for requirement in found.requirements} == {"inconclusive"}
    assert all("stamp of their input" in requirement.remedy for requirement in found.requirements)


@pytest.mark.parametrize(("share", "outcome"), [(0.009, "pass"), (0.02, "invalid")])
def test_one_in_a_hundred_may_be_early(tmp_path: Path, share: float, outcome: str) -> None:
    run = by_stamp(tmp_path, "drop_rate <= 1 %", steps=1000, iterations=1)
    assert verdict_of(rewrite(run, earlier(0.12, share))).outcome == outcome


def test_by_order_a_node_that_drops_half_and_doubles_the_rest_is_invalid(tmp_path: Path) -> None:
    required = "drop_rate <= 1 %", "latency.p99 < 50 ms"
    run = by_order(*required, latency=np.full(STEPS, 0.005)).write(tmp_path / "run")
    found = verdict_of(rewrite(run, doubled_and_dropped))
    assert found.outcome == "invalid"
    assert "450 of 900 outputs were received before their input" in found.reason
    assert "they answer other inputs" in found.reason


def test_by_order_more_outputs_than_the_ratio_allows_are_invalid(tmp_path: Path) -> None:
    run = by_order("drop_rate <= 1 %", latency=np.full(STEPS, 0.005)).write(tmp_path / "run")
    found = verdict_of(rewrite(run, doubled))
    assert found.outcome == "invalid"
    assert "received 1,800 outputs for 900 inputs" in found.reason
    assert "its ratio allows 900" in found.reason
    assert "Set the ratio of the monitor" in found.requirements[0].remedy


def lossy(lost: int) -> NDArray[np.float64]:
    latency = np.full(STEPS, 0.015)
    latency[100 : 100 + lost] = np.nan
    return latency


@pytest.mark.parametrize("metric", ["latency.p50", "latency.mean", "latency_from_due.p99"])
def test_by_order_one_lost_message_makes_the_latency_unknown(tmp_path: Path, metric: str) -> None:
    run = by_order(f"{metric} < 1 s", "drop_rate <= 5 %", latency=lossy(1)).write(tmp_path / "run")
    latency, drops = verdict_of(run).requirements
    assert latency.outcome == "inconclusive"
    assert "unknown: outputs are matched by order, and 3 of 900 are missing" in latency.reason
    assert "Match by stamp" in latency.remedy
    assert drops.outcome == "pass"
    (order,) = drops.notes
    assert order == ("Outputs are matched by order: a lost output and a duplicate cancel out.")


def test_nor_is_it_compared_with_a_baseline(tmp_path: Path) -> None:
    run = by_order("latency.p50 <= 105 % of baseline", latency=lossy(1)).write(tmp_path / "run")
    samples = read_samples(run)
    found = judge(run.plan.objectives, samples, decision_policy(run.plan), _never_asked)
    assert [requirement.outcome for requirement in found.requirements] == ["inconclusive"]
    assert "matched by order, and 3 of 900 are missing" in found.requirements[0].reason


def _never_asked(question: RequirementCase) -> RequirementVerdict:
    raise AssertionError(question)


@pytest.mark.usefixtures("without_charts")
def test_an_unknown_latency_is_in_no_report(tmp_path: Path) -> None:
    latencies = lossy(1)
    run = Ratioed(
        segments=[Played(30, lossy(0)), Played(30, latencies)],
        objectives={"all": objective("drop_rate <= 5 %")},
        match="order",
    ).write(tmp_path / "run")
    (rate,) = summarise(read_samples(run)).rates
    first, second = (iteration.monitors["detections"] for iteration in rate.iterations)
    assert first.latency.p50 == pytest.approx(0.015)
    assert (second.latency.n, second.latency.p50, second.times("latency_from_due").max) == (
        0,
        None,
        None,
    )
    assert second.unknown_latency
    assert rate.pooled.monitors["detections"].latency.n == 0
    assert rate.pooled.monitors["detections"].times("interval").n > 0
    result = result_of(run)
    told = " ".join(notes(result, verbose=True))
    assert "the latency is unknown: outputs are matched by order, and 1 of 600" in told
    reported = ReportInput(result=result, run=run)
    for name in FORMATS:
        assert renderer(name)(reported)
    answers = [
        answer.segment.id
        for monitor in run.plan.monitors
        for answer in expected_answers(run, monitor)
    ]
    assert set(answers) == {"iteration-001"}


@pytest.mark.parametrize(("periods", "usable"), [(1.4, True), (1.6, False)])
def test_two_periods_of_lateness_at_1_khz_are_invalid(
    tmp_path: Path, periods: float, usable: bool
) -> None:
    late = np.full(2000, periods / 1000)
    run = Simulation(
        segments=[Played(1000, np.full(2000, 1e-3), late=late)],
        objectives={"all": objective("latency.p50 < 60 ms", at="1 kHz")},
    ).write(tmp_path / "run")
    found = verdict_of(run)
    assert (found.outcome == "pass") == usable
    assert usable or "began over 1.5 ms after they were due" in found.reason


def reported(tmp_path: Path, rmw: str, *, untimed: bool) -> Result:
    run = by_stamp(tmp_path, "missed == 0", steps=30, iterations=1)
    if untimed:

        def as_taken(_: Rows, rows: Rows) -> Rows:
            rows = rows.copy()
            rows["received_ns"] = rows["taken_ns"]
            return rows

        run = rewrite(run, as_taken)
    return msgspec.structs.replace(result_of(run), versions={"rmw": rmw})
