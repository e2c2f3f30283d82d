"""result.json: complete, valid by its schema, and the same bytes each time."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from jsonschema import Draft202012Validator

from r2bspec.judge.judge_run import from_json, result_of, to_json
from r2bspec.report.headline import headline
from r2bspec.report.result_json import result_schema, result_schema_text
from r2bspec.report.terminal import to_text
from run_simulation import Played, Simulation, objective

ROOT = Path(__file__).parents[3]

SIMULATIONS = {
    "usual": Simulation(
        segments=[Played(30, np.full(300, 0.02))] * 3,
        objectives={"fast": objective("latency.p99 < 60 ms", "throughput.mean > 1 Hz")},
    ),
    "silent": Simulation(
        segments=[Played(30, [np.nan] * 30)],
        objectives={"fast": objective("latency.p99 < 60 ms", "nonsense < 3")},
    ),
    "lost": Simulation(
        segments=[Played(30, [0.01] * 50 + [np.nan] * 50)],
        objectives={"fast": objective("latency.p99 < 60 ms", "latency.max < 1 s")},
    ),
    "empty": Simulation(status="incomplete", reason="interrupted"),
    "of nothing": Simulation(
        objectives={"rate": objective("throughput.mean > 9 % of offered", at="")}
    ),
}


@pytest.fixture(params=SIMULATIONS, name="simulation")
def simulations(request: pytest.FixtureRequest) -> Simulation:
    return SIMULATIONS[request.param]


def test_results_are_valid_by_the_schema_and_read_back(
    simulation: Simulation, tmp_path: Path
) -> None:
    result = result_of(simulation.write(tmp_path))
    content = to_json(result)
    Draft202012Validator(result_schema()).validate(json.loads(content))
    assert from_json(content) == result


def test_judging_twice_gives_the_same_bytes(simulation: Simulation, tmp_path: Path) -> None:
    run = simulation.write(tmp_path)
    assert to_json(result_of(run)) == to_json(result_of(run))


def test_every_result_can_be_shown(simulation: Simulation, tmp_path: Path) -> None:
    text = to_text(result_of(simulation.write(tmp_path)), tmp_path, 80)
    result = result_of(simulation.write(tmp_path / "again"))
    assert text.split("\n\n")[0].replace("\n", " ").startswith(headline(result))
    assert "A simulated run" in text.splitlines()
    assert str(tmp_path) in text.splitlines()[-1]


def test_the_schema_is_one() -> None:
    Draft202012Validator.check_schema(json.loads(result_schema_text()))


def test_a_result_says_what_it_rests_on(tmp_path: Path) -> None:
    run = SIMULATIONS["usual"].write(tmp_path)
    result = result_of(run)
    assert result.plan_hash == run.record.plan_hash
    assert result.dataset["sha256"] == "0" * 64
    assert result.machine["cores"] == 2
    assert result.versions["r2bspec"] == "0.0.0"
    assert result.spec == run.spec_text()
    assert result.objectives["fast"].at == "30 Hz"
    assert result.objectives["fast"].require[0] == "latency.p99 < 60 ms"


def test_other_objectives_are_named(tmp_path: Path) -> None:
    run = SIMULATIONS["usual"].write(tmp_path)
    result = result_of(run, {"slow": objective("latency.p50 < 1 ms")}, judged_by="stricter")
    assert (result.judged_by, result.verdict.outcome) == ("stricter", "fail")
    assert "judged by the objectives and the gate of stricter" in to_text(result)
