"""``r2bspec judge``, as a user runs it."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from command_line import Call
from example_spec import example
from r2bspec.record.run_record import ConfirmationRecord
from run_simulation import Played, Simulation, objective


@pytest.fixture(name="run")
def run_folder(tmp_path: Path) -> Path:
    return (
        Simulation(
            segments=[Played(30, np.full(300, 0.02))],
            objectives={"fast": objective("latency.p99 < 60 ms")},
        )
        .write(tmp_path / "run")
        .folder
    )


def test_the_exit_status_is_the_verdict(run: Path, call: Call) -> None:
    before = sorted(run.rglob("*"))
    out = call("judge", run, status=0).out
    assert "PASS" in out
    assert out.rstrip().endswith(str(run))
    assert sorted(run.rglob("*")) == before


def test_json_is_the_content_of_the_result(run: Path, call: Call) -> None:
    first = call("judge", run, "--format", "json", "--write", status=0).out
    assert json.loads(first)["verdict"]["outcome"] == "pass"
    assert (run / "result.json").read_text() == first
    assert call("judge", run, "--format", "json").out == first


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


def test_another_spec_s_objectives(run: Path, tmp_path: Path, call: Call) -> None:
    spec = spec_with_gate(tmp_path, "", "latency.p50 < 1 ms")
    out = call("judge", run, "--spec", spec, status=1).out
    assert "latency.p50 < 1 ms" in out
    assert "judged by the objectives and the gate of stricter" in out


# 7 of 300 messages over the limit of a p98 are not quite enough to show anything at 95 %.
OPEN = Simulation(segments=[Played(30, np.where(np.arange(300) % 43 == 5, 0.02, 0.01))])
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
    run = simulation.write(tmp_path / "run").folder
    spec = spec_with_gate(tmp_path, gate, requirement)
    text = " ".join(call("judge", run, "--spec", spec, status=status).out.split())
    assert ("its second run does not count" in text) == (gate == "confirm: false")


@pytest.mark.parametrize(
    ("gate", "requirement", "line"),
    [("interference: ignore", "latency.p50 < 15 ms", 9), ("", "latency.p50 < 1 Hz", 10)],
)
def test_a_mistake_of_the_other_spec_is_explained(
    run: Path, tmp_path: Path, call: Call, gate: str, requirement: str, line: int
) -> None:
    ended = call("judge", run, "--spec", spec_with_gate(tmp_path, gate, requirement), status=2)
    assert f"other.r2b.yaml:{line}" in ended.err


def test_what_is_no_run_is_said_in_two_lines(tmp_path: Path, call: Call) -> None:
    captured = call("judge", tmp_path, status=2)
    assert "is not a run folder" in captured.err
    assert "help:" in captured.err
    assert not captured.out


def test_no_ros_is_needed_and_a_poor_terminal_is_enough(run: Path) -> None:
    code = (
        "import sys; sys.modules['rclpy'] = None;"
        "from r2bspec.cli.main import main; sys.exit(main())"
    )
    environment = {**os.environ, "PYTHONIOENCODING": "ascii", "COLUMNS": "80"}
    done = subprocess.run(
        [sys.executable, "-c", code, "judge", str(run)],
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )
    assert (done.returncode, done.stderr) == (0, "")
    assert "PASS" in done.stdout
    assert "\x1b" not in done.stdout
