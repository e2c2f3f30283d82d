"""Nodes of different styles run as they are, in few runs: all of them answer every message."""

from __future__ import annotations

import importlib.util
from typing import Any

import pytest

pytest.importorskip("rclpy")

from nightly import only_nightly
from node_styles import write_workspace
from ros_runs import IMAGE, Bench, Finished, quick_input, relay_spec


@pytest.fixture(scope="module")
def workspace(tmp_path_factory: pytest.TempPathFactory) -> Bench:
    """A folder of specs, in no workspace: what is beside it is not read before it runs."""
    folder = write_workspace(tmp_path_factory.mktemp("workspace"))
    (folder.parent / "src" / "drive_pkg" / "package.xml").unlink()
    return Bench(folder)


def spec(nodes: dict[str, Any], outputs: dict[str, str], inputs: list[str]) -> dict[str, Any]:
    """All nodes side by side: each reads an input of its own, and has a monitor of its own."""
    return relay_spec(
        playback={"inputs": {input_: quick_input("loaded") for input_ in inputs}},
        graph={"nodes": nodes},
        monitors={key: {"topic": name, "format": IMAGE} for key, name in outputs.items()},
    )


def assert_all_answer(bench: Bench, wanted: dict[str, Any]) -> Finished:
    # With queues of ten messages, a busy machine loses some by itself.
    for _ in range(3):
        done = bench.run(wanted)
        done.assert_complete()
        if not any(done.monitor(each)["missed"] for each in wanted["monitors"]):
            break
    for each in wanted["monitors"]:
        done.assert_counts(20, each)
    return done


STARTER = """
import rclpy


class Starter(Node):
    def __init__(self):
        rclpy.init()
        super().__init__("starter")
        output = self.create_publisher(Image, "started", 10)
        self.create_subscription(Image, "start", output.publish, 10)
"""


def test_programs_factories_and_states(workspace: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    workspace.write_node("starter.py", STARTER)
    monkeypatch.setenv("PYTHONPATH", str(workspace.folder.parent / "src" / "drive_pkg"))
    nodes = {
        "detector": {"python": "./detector.py:main"},
        "lidar_filter": {"python": "./lidar_filter.py:LidarFilter", "lifecycle": "active"},
        "odometry": {"python": "./odometry.py:main"},
        "grasp_server": {"python": "./grasp_server.py:make"},
        "driver": {
            "python": "../src/drive_pkg/drive_pkg/driver_node.py:main",
            "executor": "multi_threaded",
        },
        "smoother": {"python": "../src/drive_pkg/drive_pkg/smoother.py:main"},
        "starter": {"python": "./starter.py:Starter"},
        "module": {
            "python": "drive_pkg.driver_node.main",
            "remappings": {"goal": "target", "cmd": "drive"},
        },
        "threshold": {
            "python": "./threshold.py:Threshold",
            "parameters": "./threshold.yaml",
            "executor": "multi_threaded",
            "threads": 2,
        },
    }
    outputs = {
        "detector": "detections",
        "lidar_filter": "filtered",
        "odometry": "odom",
        "grasp_server": "grasp_view",
        "driver": "cmd",
        "smoother": "smoothed",
        "starter": "started",
        "module": "drive",
        "threshold": "foreground",
    }
    inputs = ["image", "scan", "imu", "camera", "goal", "target", "frame", "start", "raw"]
    assert_all_answer(workspace, spec(nodes, outputs, inputs))


@pytest.mark.parametrize(
    ("module", "node", "inputs", "output"),
    [
        ("message_filters", "stereo_sync", ["left", "right"], "disparity"),
        ("tf2_ros", "projector", ["depth"], "projected"),
    ],
)
def test_nodes_that_need_more_packages(
    workspace: Bench, module: str, node: str, inputs: list[str], output: str
) -> None:
    if importlib.util.find_spec(module) is None:
        pytest.skip(f"{module} is not installed")
    nodes = {node: {"python": f"./{node}.py:main"}}
    assert_all_answer(workspace, spec(nodes, {"out": output}, inputs))


FAILING = """
import rclpy


class Broken(Node):
    def __init__(self):
        super().__init__("broken")
        self.create_publisher(Image, "output", 10)
        self.create_subscription(Image, "input", print, 10)
        raise KeyError("calibration")


def main():
    rclpy.init()
    rclpy.spin(Broken())
"""


@only_nightly()
def test_a_program_that_fails_says_why(workspace: Bench) -> None:
    workspace.write_node("failing.py", FAILING)
    nodes = {"relay": {"python": "./failing.py:main"}}
    done = workspace.run(spec(nodes, {"out": "output"}, ["input"]))
    assert "node /r2b/relay cannot be created: KeyError: 'calibration'" in done.error
