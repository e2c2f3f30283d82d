"""A search for a deployment on real ROS 2, from the trials to the proof."""

from __future__ import annotations

import json
import subprocess
import sys

import pytest

pytest.importorskip("rclpy")
pytest.importorskip("optuna")

from ros_runs import HANG_S, Bench, relay_node, relay_spec
from ros_runs import bench as bench

BUSY_MS = 20.0
"""What the relay computes for each of 20 images a second: two fifths of a core."""

SPEC = relay_spec(
    graph={"nodes": {"relay": relay_node(BUSY_MS)}},
    slos={"all": {"at": "20 Hz", "require": ["drop_rate <= 90 %"]}},
    tune={
        "levers": ["placement"],
        "values": {"graph.nodes.relay.parameters.service_time_ms": [0.0]},
        "pairs": 3,
        "trials": 2,
    },
)


def test_a_cheaper_deployment_is_found_and_proved(bench: Bench) -> None:
    spec = bench.write(SPEC)
    folder = bench.folder / "search"
    words = [sys.executable, "-m", "r2bspec", "tune", str(spec), "--output", str(folder), "--write"]
    done = subprocess.run(words, capture_output=True, text=True, timeout=HANG_S, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    found = json.loads((folder / "tuning.json").read_text())
    assert found["outcome"] == "improved"
    (choice,) = found["winner"]["choices"]
    assert choice["lever"] == "graph.nodes.relay.parameters.service_time_ms"
    proof = found["proof"]
    assert proof["pairs"] == 3
    # Nothing is left of the relay's own work, and its middleware takes less than that.
    assert proof["ratio"] < proof["upper"] < 1
    assert [trial["number"] for trial in found["trials"]] == [0, 1]
    assert "service_time_ms: 0.0" in spec.read_text()
    assert {"tuning.html", "deployment.launch.py", "trials"} <= {
        each.name for each in folder.iterdir()
    }
    assert (folder / "trials" / "000" / "record.json").exists()
