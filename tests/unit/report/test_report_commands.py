"""The verbs ``judge``, ``report``, and ``compare``, and the reports of ``run``."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from command_line import Call
from example_spec import example
from r2bspec import api
from r2bspec.errors import R2bspecError
from r2bspec.plan.prepared_benchmark import PreparedBenchmark
from r2bspec.record.run_folder import Run
from r2bspec.record.run_record import ConfirmationRecord
from report_runs import EMPTY
from run_simulation import Played, Simulation, objective

# The verbs ``report``, and ``compare``, and the reports of ``run``, as a user asks.


@pytest.fixture(name="run")
def run_folder(usual_run: Run) -> Path:
    return usual_run.folder


def test_a_report_of_a_folder_and_of_a_result(run: Path, tmp_path: Path, call: Call) -> None:
    kept = tmp_path / "result.json"
    call("report", run, "--report", f"json={kept}", status=0)
    assert call("report", kept, "--report", "csv=-", status=0).out.startswith("run_id,")


def test_no_report_is_a_mistake(run: Path, call: Call) -> None:
    assert "no report" in call("report", run, status=2).err


@pytest.mark.parametrize("content", [None, "", "{}", "[]"])
def test_what_is_no_result_is_said(tmp_path: Path, content: str | None, call: Call) -> None:
    path = tmp_path / "result.json"
    if content is not None:
        path.write_text(content)
    assert "result.json" in call("report", path, "--report", "json=-", status=2).err


def test_compare_prints_and_does_not_gate(run: Path, call: Call) -> None:
    for form in ("text", "markdown", "json"):
        out = call("compare", run, run, run, "--format", form, status=0).out
        assert out.count("same") > 10


def test_a_run_that_fails_still_has_its_reports(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, call: Call
) -> None:
    def fail(_prepared: Any, folder: Path, _progress: Any, **_ways: Any) -> None:
        EMPTY.write(folder)
        raise R2bspecError("a process died")

    prepared = PreparedBenchmark(EMPTY.plan(), tmp_path, "")
    monkeypatch.setattr(api, "prepare", lambda *_, **__: prepared)
    monkeypatch.setattr(api, "run", fail)
    target = tmp_path / "junit.xml"
    options = ("-o", tmp_path / "run", "--quiet", "--report", f"junit={target}")
    assert "a process died" in call("run", "a.r2b.yaml", *options, status=4).err
    assert 'errors="1"' in target.read_text()


# ``r2bspec judge``, as a user runs it.


@pytest.fixture(name="judged")
def judged_folder(tmp_path: Path) -> Path:
    return (
        Simulation(
            segments=[Played(30, np.full(300, 0.02))],
            objectives={"fast": objective("latency.p99 < 60 ms")},
        )
        .write(tmp_path / "judged")
        .folder
    )


def test_the_exit_status_is_the_verdict(judged: Path, call: Call) -> None:
    before = sorted(judged.rglob("*"))
    out = call("judge", judged, status=0).out
    assert "PASS" in out
    assert out.rstrip().endswith(str(judged))
    assert sorted(judged.rglob("*")) == before


def test_json_is_the_content_of_the_result(judged: Path, call: Call) -> None:
    first = call("judge", judged, "--format", "json", "--write", status=0).out
    assert json.loads(first)["verdict"]["outcome"] == "pass"
    assert (judged / "result.json").read_text() == first
    assert call("judge", judged, "--format", "json").out == first


def spec_with_gate(tmp_path: Path, gate: str, requirement: str) -> Path:
    spec = tmp_path / "other.r2b.yaml"
    text = example(
        "stricter",
        monitors="{detections: {topic: output, format: sensor_msgs/msg/Image}}",
        benchmark=f"{{rates: [30 Hz], gate: {{{gate}}}}}",
        slos=f"{{fast: {{at: 30 Hz, require: [{requirement}]}}}}",
    )
    spec.write_text(text)
    return spec


def test_another_spec_s_objectives(judged: Path, tmp_path: Path, call: Call) -> None:
    spec = spec_with_gate(tmp_path, "", "latency.p50 < 1 ms")
    out = call("judge", judged, "--spec", spec, status=1).out
    assert "latency.p50 < 1 ms" in out
    assert "Judged by the objectives and the gate of stricter" in out


# 10 of 300 messages over the limit of a p98 are not quite enough to show anything at 95 %.
OPEN = Simulation(segments=[Played(30, np.where(np.arange(300) % 30 == 5, 0.02, 0.01))])
BUSY = Simulation(
    segments=[Played(30, np.full(300, 0.02))], interference={"busy_s": 1.9, "stolen_s": 0.3}
)
CONFIRMED = Simulation(
    segments=[
        Played(30, np.full(300, 0.02)),
        Played(30, np.full(300, 0.01), kind="confirmation"),
    ],
    confirmation=ConfirmationRecord(search=None, sustained=()),
)


@pytest.mark.parametrize(
    ("simulation", "requirement", "gate", "status"),
    [
        (OPEN, "latency.p98 < 15 ms", "", 3),
        (OPEN, "latency.p98 < 15 ms", "inconclusive: fail", 1),
        (OPEN, "latency.p98 < 15 ms", "inconclusive: pass", 0),
        (OPEN, "latency.p98 < 15 ms", "confidence: 60 %", 1),
        (BUSY, "latency.p50 < 19 ms", "", 3),
        (BUSY, "latency.p50 < 19 ms", "interference: tolerate", 1),
        (BUSY, "latency.p50 < 19 ms", "interference: note", 3),
        (CONFIRMED, "latency.p50 < 15 ms", "", 3),
        (CONFIRMED, "latency.p50 < 15 ms", "confirm: false", 1),
    ],
)
def test_another_spec_s_gate_applies(
    tmp_path: Path, call: Call, simulation: Simulation, requirement: str, gate: str, status: int
) -> None:
    judged = simulation.write(tmp_path / "judged").folder
    spec = spec_with_gate(tmp_path, gate, requirement)
    text = " ".join(call("judge", judged, "--spec", spec, status=status).out.split())
    assert ("its second run does not count" in text) == (gate == "confirm: false")


@pytest.mark.parametrize(
    ("gate", "requirement", "line"),
    [("interference: ignore", "latency.p50 < 15 ms", 9), ("", "latency.p50 < 1 Hz", 10)],
)
def test_a_mistake_of_the_other_spec_is_explained(
    judged: Path, tmp_path: Path, call: Call, gate: str, requirement: str, line: int
) -> None:
    ended = call("judge", judged, "--spec", spec_with_gate(tmp_path, gate, requirement), status=2)
    assert f"other.r2b.yaml:{line}" in ended.err


def test_no_ros_is_needed_and_a_poor_terminal_is_enough(judged: Path) -> None:
    code = (
        "import sys; sys.modules['rclpy'] = None;"
        "from r2bspec.cli.main import main; sys.exit(main())"
    )
    environment = {**os.environ, "PYTHONIOENCODING": "ascii", "COLUMNS": "80"}
    done = subprocess.run(
        [sys.executable, "-c", code, "judge", str(judged)],
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )
    assert (done.returncode, done.stderr) == (0, "")
    assert "PASS" in done.stdout
    assert "\x1b" not in done.stdout


@pytest.mark.parametrize(
    "words",
    [("--set", "a.b=1"), ("--case", "a=1"), ("--quiet",), ("--verbose",), ("--pairs", "3")],
)
def test_options_of_specs_are_refused_for_finished_runs(
    call: Call, tmp_path: Path, words: tuple[str, ...]
) -> None:
    assert words[0] in call("compare", tmp_path, tmp_path, *words, status=2).err
