"""result.json: complete, valid by its schema, and the same bytes each time."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace

import msgspec
import pytest
from jsonschema import Draft202012Validator

from r2bspec.compare.report_input import ReportInput
from r2bspec.judge.judge_run import from_json, result_of, to_json
from r2bspec.record.run_folder import Run
from r2bspec.report.result_json import result_schema, result_schema_text
from r2bspec.report.terminal import to_text
from report_runs import SIMULATIONS
from run_simulation import objective

Reported = Callable[[str], ReportInput]


@pytest.mark.parametrize("name", SIMULATIONS)
def test_a_result_is_valid_by_the_schema_and_is_always_the_same(
    reported: Reported, name: str
) -> None:
    run, result = reported(name).run, reported(name).result
    content = to_json(result)
    Draft202012Validator(result_schema()).validate(json.loads(content))
    assert from_json(content) == result
    assert run is not None
    assert to_json(result_of(run)) == content


def test_the_schema_is_one() -> None:
    Draft202012Validator.check_schema(json.loads(result_schema_text()))


def test_a_result_says_what_it_rests_on(usual_run: Run) -> None:
    run, result = usual_run, result_of(usual_run)
    assert result.plan_hash == run.record.plan_hash
    assert result.dataset["sha256"] == "0" * 64
    assert result.machine["cores"] == 2
    assert result.versions["r2bspec"] == "0.0.0"
    assert result.spec == run.spec_text()
    assert result.objectives["camera"].at == "30 Hz"
    assert result.objectives["camera"].require[0] == "latency.p99 < 60 ms"


def test_other_objectives_are_named(usual_run: Run) -> None:
    result = result_of(usual_run, {"slow": objective("latency.p50 < 1 ms")}, judged_by="stricter")
    assert (result.judged_by, result.verdict.outcome) == ("stricter", "fail")
    assert "judged by the objectives and the gate of stricter" in to_text(result)


def test_the_label_of_a_monitor_in_the_plan_is_in_the_result(usual_run: Run) -> None:
    (monitor,) = usual_run.plan.monitors
    labelled = msgspec.structs.replace(monitor, label="Tag detections")
    plan = msgspec.structs.replace(usual_run.plan, monitors=(labelled,))
    result = result_of(replace(usual_run, plan=plan))
    assert result_of(usual_run).monitor_labels == {}
    assert result.monitor_labels == {monitor.name: "Tag detections"}
    assert result.monitor_title("other") == "other"
