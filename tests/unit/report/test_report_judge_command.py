"""``r2bspec judge``, as a user runs it."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from r2bspec.cli.main import main
from r2bspec.record.run_record import ConfirmationRecord
from run_simulation import Played, Simulation, objective

OTHER = """\
r2bspec: 1
name: stricter
data_loader: {bag: nowhere, topics: {/a: image}}
playback: {inputs: {image: {from: image, format: sensor_msgs/msg/Image}}}
graph: {nodes: {relay: {python: r2bspec.nodes.RelayNode}}}
monitors: {detections: {topic: output, format: sensor_msgs/msg/Image}}
benchmark: {rates: [30 Hz]}
slos: {fast: {at: 30 Hz, require: [latency.p50 < 1 ms]}}
"""


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


def test_the_exit_status_is_the_verdict(run: Path, capsys: pytest.CaptureFixture[str]) -> None:
    before = sorted(run.rglob("*"))
    assert main(["judge", str(run)]) == 0
    out = capsys.readouterr().out
    assert "PASS" in out
    assert out.rstrip().endswith(str(run))
    assert sorted(run.rglob("*")) == before


def test_json_is_the_content_of_the_result(
    run: Path, capfdbinary: pytest.CaptureFixture[bytes]
) -> None:
    assert main(["judge", str(run), "--format", "json", "--write"]) == 0
    first = capfdbinary.readouterr().out
    assert json.loads(first)["verdict"]["outcome"] == "pass"
    assert (run / "result.json").read_bytes() == first
    main(["judge", str(run), "--format", "json"])
    assert capfdbinary.readouterr().out == first


def test_another_spec_s_objectives(
    run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    spec = tmp_path / "other.r2b.yaml"
    spec.write_text(OTHER)
    assert main(["judge", str(run), "--spec", str(spec)]) == 1
    out = capsys.readouterr().out
    assert "latency.p50 < 1 ms" in out
    assert "judged by the objectives and the gate of stricter" in out


def spec_with_gate(tmp_path: Path, gate: str, requirement: str) -> str:
    spec = tmp_path / "other.r2b.yaml"
    spec.write_text(
        OTHER.replace("[30 Hz]", f"[30 Hz], gate: {{{gate}}}").replace(
            "latency.p50 < 1 ms", requirement
        )
    )
    return str(spec)


@pytest.mark.parametrize(
    ("gate", "status"),
    [("", 3), ("inconclusive: fail", 1), ("inconclusive: pass", 0), ("confidence: 60 %", 1)],
)
def test_another_spec_s_gate_applies(tmp_path: Path, gate: str, status: int) -> None:
    # 7 of 300 messages over the limit of a p98 are not quite enough to show anything at 95 %.
    latency = np.where(np.arange(300) % 43 == 5, 0.02, 0.01)
    run = Simulation(segments=[Played(30, latency)]).write(tmp_path / "run").folder
    spec = spec_with_gate(tmp_path, gate, "latency.p98 < 15 ms")
    assert main(["judge", str(run), "--spec", spec]) == status


@pytest.mark.parametrize(
    ("gate", "status"), [("", 3), ("interference: tolerate", 1), ("interference: note", 3)]
)
def test_another_spec_s_interference_applies(tmp_path: Path, gate: str, status: int) -> None:
    busy = {"busy_s": 1.9, "stolen_s": 0.3}
    segments = [Played(30, np.full(300, 0.02))]
    run = Simulation(segments=segments, interference=busy).write(tmp_path / "run").folder
    spec = spec_with_gate(tmp_path, gate, "latency.p50 < 19 ms")
    assert main(["judge", str(run), "--spec", spec]) == status


@pytest.mark.parametrize(("gate", "status"), [("", 3), ("confirm: false", 1)])
def test_without_confirm_in_the_other_spec_the_first_run_counts(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], gate: str, status: int
) -> None:
    confirmation = ConfirmationRecord(search=None, sustained=())
    segments = [
        Played(30, np.full(300, 0.02)),
        Played(30, np.full(300, 0.01), kind="confirmation"),
    ]
    run = Simulation(segments=segments, confirmation=confirmation).write(tmp_path / "run").folder
    spec = spec_with_gate(tmp_path, gate, "latency.p50 < 15 ms")
    assert main(["judge", str(run), "--spec", spec]) == status
    said = " ".join(capsys.readouterr().out.split())
    assert ("its second run does not count" in said) == (status == 1)


def test_a_gate_that_is_wrong_is_explained(
    run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    spec = spec_with_gate(tmp_path, "interference: ignore", "latency.p50 < 15 ms")
    assert main(["judge", str(run), "--spec", spec]) == 2
    assert "other.r2b.yaml:7" in capsys.readouterr().err


def test_a_broken_spec_is_explained(
    run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    spec = tmp_path / "other.r2b.yaml"
    spec.write_text(OTHER.replace("< 1 ms", "< 1 Hz"))
    assert main(["judge", str(run), "--spec", str(spec)]) == 2
    assert "other.r2b.yaml:8" in capsys.readouterr().err


def test_what_is_no_run_is_said_in_two_lines(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["judge", str(tmp_path)]) == 2
    captured = capsys.readouterr()
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
