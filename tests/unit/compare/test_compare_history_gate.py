"""A run against a history, and against a stored run, without ROS: the runs are simulated."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import msgspec
import numpy as np
import pytest

from pair_simulation import latencies
from r2bspec.compare.comparison import compare, read_compared_result
from r2bspec.compare.errors import IncomparableError
from r2bspec.compare.history import open_history
from r2bspec.compare.history_gate import (
    add_to_history,
    baseline_from_history,
    baseline_from_stored_run,
    grown_since,
    history_entry,
    run_with_baseline,
    unnamed_growth,
    write_baseline,
)
from r2bspec.compare.report_input import ReportInput
from r2bspec.judge.judge_run import result_of, to_json
from r2bspec.judge.result import Result
from r2bspec.judge.verdict import InconclusivePolicy
from r2bspec.language.quantities import Duration
from r2bspec.plan.plan import GatePlan, Plan
from r2bspec.record.baseline_file import BaselineRecord, BaselineSeries
from r2bspec.record.run_folder import Run, RunFolder, open_run
from r2bspec.report.format_registry import renderer
from r2bspec.report.terminal import to_text
from run_simulation import Played, Simulation, objective
from simulated_anatomies import CHAIN, ObservedSimulation

NO_REGRESSION = {"no_regression": objective("latency.p50 <= 110 % of baseline")}
LEVELS = [0.020, 0.0204, 0.0197, 0.0201, 0.0199, 0.0202]


def simulated(*levels_s: float, silent: bool = False, broken: str = "") -> Simulation:
    mute = ("detections",) if silent else ()
    return Simulation(
        segments=[Played(30.0, latencies(level), silent=mute) for level in levels_s],
        objectives=NO_REGRESSION,
        status="incomplete" if broken else "complete",
        reason=broken,
    )


class Machine:
    """Makes runs of given latencies, one after the other, instead of running anything."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.history = folder / "history.sqlite"
        self.made = 0

    def run(self, *simulations: Simulation) -> Result:
        """A run, and the fresh ones that it may lead to."""
        coming = iter(simulations)

        def make(folder: RunFolder, plan: Plan) -> Result:
            self.made += 1
            simulation = next(coming)
            folder.release()
            folder.path.rmdir()
            simulation.write(folder.path)
            record = open_run(folder.path).record
            run_id = f"{self.made:016x}"
            folder.write_record(msgspec.structs.replace(record, run_id=run_id))
            assert plan.gate.confirm == (folder.path.name != "confirm")
            return result_of(open_run(folder.path))

        target = RunFolder.create(self.folder / f"run{self.made}")
        return run_with_baseline(
            make, simulations[0].plan(), target, history=self.history, stored=None
        )


@pytest.fixture
def machine(tmp_path: Path) -> Machine:
    return Machine(tmp_path)


def test_a_history_gates_once_it_has_enough_runs(machine: Machine) -> None:
    settled = [machine.run(simulated(level)).verdict for level in LEVELS]
    assert [one.outcome for one in settled] == ["pass"] * 6
    learning = [one.requirements[0].learning for one in settled]
    assert learning == ["1 of 5", "2 of 5", "3 of 5", "4 of 5", "5 of 5", ""]
    assert [one.requirements[0].outcome for one in settled] == ["inconclusive"] * 5 + ["pass"]
    assert settled[2].reason.endswith("earning, 3 of 5: 1 requirement waits for the history.")
    assert settled[2].requirements[0].remedy == "5 are needed: 3 more."
    assert settled[5].requirements[0].method == "prediction interval"


def test_while_a_history_learns_the_other_requirements_count(machine: Machine) -> None:
    fast = replace(
        simulated(0.02),
        objectives=NO_REGRESSION | {"fast": objective("latency.p50 < 10 ms")},
    )
    verdict = machine.run(fast, fast).verdict
    assert (verdict.outcome, verdict.exit_code) == ("fail", 1)
    assert {
        requirement.objective: requirement.learning for requirement in verdict.requirements
    } == {
        "fast": "",
        "no_regression": "1 of 5",
    }


@pytest.mark.parametrize(
    ("inconclusive", "outcome"), [("report", "pass"), ("pass", "pass"), ("fail", "fail")]
)
def test_a_history_that_learns_fails_only_if_the_gate_asks_for_it(
    tmp_path: Path, inconclusive: InconclusivePolicy, outcome: str
) -> None:
    run = simulated(0.02).write(tmp_path / "run")
    write_baseline(run.folder, baseline_from_history(tmp_path / "history.sqlite", run))
    result = result_of(run, gate=GatePlan(inconclusive=inconclusive))
    assert result.verdict.outcome == outcome
    shown = to_text(result, run.folder, 100)
    assert "learning, 1 of 5" in " ".join(shown.split())
    if inconclusive == "report":
        reported = ReportInput(result=result, run=run)
        junit = renderer("junit")(reported).decode()
        assert "<error" not in junit
        assert "<failure" not in junit
        assert "::error" not in renderer("github")(reported).decode()


def test_a_failure_is_confirmed_by_a_fresh_run_and_is_no_baseline(machine: Machine) -> None:
    for level in LEVELS:
        machine.run(simulated(level))
    failed = machine.run(simulated(0.03), simulated(0.03))
    assert (failed.verdict.outcome, failed.verdict.exit_code) == ("fail", 1)
    assert failed.verdict.reason.endswith("A second run confirmed the comparison with the history.")
    assert failed.baseline is not None
    assert failed.baseline.confirmed
    contradicted = machine.run(simulated(0.03), simulated(0.02))
    assert contradicted.verdict.outcome == "inconclusive"
    with open_history(machine.history) as history:
        outcomes = [run.outcome for run in history.runs()]
        assert outcomes.count("fail") == 1
    assert machine.run(simulated(0.03), simulated(0.03)).verdict.outcome != "pass"


def test_judging_again_does_not_ask_the_history(machine: Machine) -> None:
    for level in LEVELS:
        machine.run(simulated(level))
    result = machine.run(simulated(0.03), simulated(0.03))
    machine.history.unlink()
    folder = machine.folder / "run6"
    assert to_json(result_of(open_run(folder))) == to_json(result)
    assert (folder / "result.json").read_bytes() == to_json(result)


def test_what_says_nothing_of_the_graph_is_not_remembered(machine: Machine) -> None:
    broken = machine.run(simulated(0.02, broken="R2B631: a process ended"))
    assert broken.verdict.outcome == "incomplete"
    with open_history(machine.history) as history:
        assert history.runs() == ()


def test_silence_fails_whatever_the_history_says(machine: Machine) -> None:
    first = machine.run(simulated(0.02, silent=True), simulated(0.02, silent=True))
    assert first.verdict.outcome == "fail"
    for level in LEVELS:
        machine.run(simulated(level))
    silent = machine.run(simulated(0.02, silent=True), simulated(0.02, silent=True))
    assert silent.verdict.outcome == "fail"


def test_runs_of_another_length_are_another_history(machine: Machine) -> None:
    longer = replace(simulated(0.02, 0.02), monitors=("detections", "more"))
    for level in LEVELS:
        machine.run(simulated(level))
    assert {requirement.learning for requirement in machine.run(longer).verdict.requirements} == {
        "1 of 5"
    }


class TestStored:
    def stored(self, folder: Path, *levels: float) -> Path:
        simulated(*levels).write(folder)
        return folder

    def judged(self, base: Path, head: Simulation, folder: Path) -> Result:
        run = head.write(folder)
        write_baseline(
            folder, baseline_from_stored_run(base, run.plan, run.record.machine, force=False)
        )
        return result_of(open_run(folder))

    def test_it_advises_and_never_gates(self, tmp_path: Path) -> None:
        base = self.stored(tmp_path / "base", *LEVELS)
        for number, level in enumerate((0.02, 0.04)):
            head = simulated(*(level * each / 0.02 for each in LEVELS))
            result = self.judged(base, head, tmp_path / f"head{number}")
            (one,) = result.verdict.requirements
            assert (one.outcome, one.method) == ("inconclusive", "stored baseline")
            assert result.verdict.exit_code == 3
            would = ("would pass", "would fail")[number]
            assert would in one.reason
        assert result.baseline is not None
        assert result.baseline.kind == "stored"

    def test_a_result_file_will_do(self, tmp_path: Path) -> None:
        base = self.stored(tmp_path / "base", *LEVELS)
        path = tmp_path / "result.json"
        path.write_bytes(to_json(result_of(open_run(base))))
        result = self.judged(path, simulated(*LEVELS), tmp_path / "head")
        assert "would pass" in result.verdict.requirements[0].reason

    def test_another_machine_or_plan_is_refused_and_spelt_out(self, tmp_path: Path) -> None:
        base = self.stored(tmp_path / "base", *LEVELS)
        plan = open_run(base).plan
        faster = {"cpu": "another processor", "cores": 64}
        with pytest.raises(
            IncomparableError, match=r"(?s)machine, cpu: .* -> another processor.*cores: 2 -> 64"
        ) as caught:
            baseline_from_stored_run(base, plan, faster, force=False)
        assert "--force" in caught.value.hint
        other = msgspec.structs.replace(plan, buffer=7)
        machine = open_run(base).record.machine
        with pytest.raises(IncomparableError, match="buffer: 0 -> 7"):
            baseline_from_stored_run(base, other, machine, force=False)
        forced = baseline_from_stored_run(base, other, machine, force=True)
        assert forced.differences == ("plan, buffer: 0 -> 7",)
        # The graph may differ, as it does where one looks for an effect: the record says how.
        patient = msgspec.structs.replace(plan, start_timeout=Duration(plan.start_timeout.ns + 1))
        [said] = baseline_from_stored_run(base, patient, machine, force=False).differences
        assert said.startswith("plan, start_timeout: ")
        # What is judged, and how, may differ.
        words = msgspec.structs.replace(plan, objectives={}, gate=GatePlan(confidence=0.9))
        assert baseline_from_stored_run(base, words, machine, force=False).differences == ()


def test_accuracy_is_left_out_of_a_history(tmp_path: Path) -> None:
    run = Simulation(
        segments=[Played(30, latencies(0.02))],
        objectives={"slo": objective("accuracy.tag_missed == 0 %", "latency.p90 < 1 s")},
    ).write(tmp_path)
    entry = history_entry(run, result_of(run))
    assert entry.run_id == run.record.run_id
    assert "accuracy" not in str(entry)
    assert "latency.p90" in str(entry)


class ObservedInEveryIteration(ObservedSimulation):
    """A run of a benchmark with ``anatomy: true``."""

    def plan(self) -> Plan:
        """See `Simulation.plan`."""
        return msgspec.structs.replace(super().plan(), anatomy=True)


def observed_run(path: Path, service_s: float, seed: int) -> Run:
    graph = replace(CHAIN.with_stage("blur", service_s=service_s), seed=seed)
    run = ObservedInEveryIteration.of(graph).write(path)
    RunFolder(path).write_record(msgspec.structs.replace(run.record, run_id=path.name))
    return open_run(path)


def test_the_part_that_grew_since_a_stored_run_is_named(tmp_path: Path) -> None:
    base = observed_run(tmp_path / "base", 0.004, 0)
    head = observed_run(tmp_path / "head", 0.0048, 1)
    stored = BaselineRecord(kind="stored", source=str(base.folder), run_ids=("base",), series=())
    (grown,) = grown_since(stored, head)
    assert grown.startswith("blur: callback +7")
    assert grown_since(stored, base) == ()
    sides = [read_compared_result(run.folder) for run in (base, head)]
    assert f"grown: {grown}" in compare(sides[0], sides[1], margin=0.05, force=True).differences
    assert grown_since(msgspec.structs.replace(stored, source="/nothing"), head) == ()
    write_baseline(head.folder, msgspec.structs.replace(stored, grown=(grown,)))
    assert result_of(head).grown == (grown,)


def test_the_part_that_grew_since_a_history_is_named(tmp_path: Path) -> None:
    history = tmp_path / "history.sqlite"
    for number in range(4):
        run = observed_run(tmp_path / f"run-{number}", 0.004, number)
        add_to_history(history, run, result_of(run))
    slow = observed_run(tmp_path / "slow", 0.0048, 5)
    grown = grown_since(baseline_from_history(history, slow), slow)
    assert grown[0].startswith("blur: callback +7")
    same = observed_run(tmp_path / "same", 0.004, 6)
    assert grown_since(baseline_from_history(history, same), same) == ()


def scattered(run: Run, deviation: float, seed: int, runs: int = 5) -> BaselineRecord:
    """A history of runs like one, which differ by so much: the deviation of their logarithms."""
    random = np.random.default_rng(seed)
    return BaselineRecord(
        kind="history",
        source="history.sqlite",
        run_ids=tuple(f"run-{number}" for number in range(runs)),
        series=tuple(
            BaselineSeries(
                at_hz=stored.at_hz,
                monitor=stored.monitor,
                metric=stored.metric,
                values=tuple(stored.value * np.exp(random.normal(0, deviation, runs))),
            )
            for stored in history_entry(run, result_of(run)).metrics
            if stored.value
        ),
    )


def test_a_clear_growth_is_named_where_runs_differ_and_said_not_to_be_where_they_differ_more(
    tmp_path: Path,
) -> None:
    base = observed_run(tmp_path / "base", 0.004, 1)
    slow = observed_run(tmp_path / "slow", 0.008, 2)
    for deviation, named in ((0.03, True), (0.5, False)):
        for seed in range(5):
            history = scattered(base, deviation, seed)
            grown = grown_since(history, slow)
            assert [text.startswith("blur: callback +") for text in grown[:1]] == [True] * named
            if not named:
                (said,) = unnamed_growth(history, slow)
                assert said.startswith("no part grew beyond the scatter of 5 earlier runs (blur")


def test_the_median_of_a_part_is_named_where_its_means_scatter(tmp_path: Path) -> None:
    """As on a busy machine, where single messages take many times as long."""
    base = observed_run(tmp_path / "base", 0.004, 1)
    slow = observed_run(tmp_path / "slow", 0.006, 2)
    history = scattered(base, 0.01, 3)
    means = {
        each.metric: each
        for each in scattered(base, 0.5, 3).series
        if each.metric.endswith(".mean")
    }
    mixed = [means.get(each.metric, each) for each in history.series]
    grown = grown_since(msgspec.structs.replace(history, series=tuple(mixed)), slow)
    assert grown[0].startswith("blur: callback +2.1 ms")


def test_a_failed_verdict_says_that_no_part_is_known_to_have_grown(machine: Machine) -> None:
    def made(service_s: float, seed: int) -> Simulation:
        graph = replace(CHAIN.with_stage("blur", service_s=service_s), seed=seed)
        no_regression = {"slo": objective("latency.p50 <= 110 % of baseline", at="100 Hz")}
        return replace(ObservedInEveryIteration.of(graph), objectives=no_regression)

    for number, service_s in enumerate((0.004, 0.0046, 0.0042, 0.0039, 0.0043)):
        assert machine.run(made(service_s, number)).grown is msgspec.UNSET
    result = machine.run(made(0.008, 9), made(0.008, 10))
    assert result.verdict.outcome == "fail"
    assert result.grown is not msgspec.UNSET
    (said,) = result.grown
    assert said.startswith("no part grew beyond the scatter of 5 earlier runs (blur: callback +")
