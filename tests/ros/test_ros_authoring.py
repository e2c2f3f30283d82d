"""First specs of real systems: a running graph, a launch file with a bag, and a script."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest
import yaml

from nightly import only_nightly

pytest.importorskip("rclpy")

from r2bspec.api import validate
from r2bspec.cli.main import main
from r2bspec.execute.processes.prerequisites import reserved_domain
from ros_runs import HANG_S, Bench, node_of_others

NODE = """#!{python}
import rclpy
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from rclpy.qos import qos_profile_sensor_data
from sensor_msgs.msg import Image


class Answer(Node):
    def __init__(self, **kwargs):
        super().__init__("answer", **kwargs)
        self.declare_parameter("gain", 2.5)
        self.publisher = self.create_publisher(Image, "answer", 100)
        self.create_subscription(Image, "question", self.publisher.publish, 100)


def main():
    rclpy.init()
    try:
        rclpy.spin(Answer())
    except (KeyboardInterrupt, ExternalShutdownException):
        pass


if __name__ == "__main__":
    main()
"""
LAUNCH = """
from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, GroupAction
from launch.conditions import IfCondition, UnlessCondition
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node, PushRosNamespace


def generate_launch_description():
    simulated = LaunchConfiguration("simulated")
    answer = Node(
        package="cell",
        executable="answer",
        name="answer",
        parameters=[{"gain": 4.5}],
        remappings=[("question", LaunchConfiguration("camera"))],
    )
    simulator = Node(package="cell", executable="simulator", condition=IfCondition(simulated))
    cell = GroupAction(
        condition=UnlessCondition(simulated), actions=[PushRosNamespace("cell"), answer]
    )
    return LaunchDescription(
        [
            DeclareLaunchArgument("camera", default_value="/camera"),
            DeclareLaunchArgument("simulated", default_value="false"),
            cell,
            simulator,
        ]
    )
"""
SCRIPT = '''
"""How fast images are answered."""

import os

from launch.actions import ExecuteProcess
from launch_ros.actions import ComposableNodeContainer
from launch_ros.descriptions import ComposableNode
from ros2_benchmark import ROS2BenchmarkConfig, ROS2BenchmarkTest


def launch_setup(prefix, timeout):
    space = AnswerTest.generate_namespace()
    harness = {'namespace': space, 'package': 'ros2_benchmark'}
    here = os.path.dirname(os.path.realpath(__file__))
    # Answers every image.
    answer = ExecuteProcess(
        name='answer',
        cmd=[os.path.join(here, 'answer.py'), '--ros-args', '-r', f'__ns:={space}'])
    return [answer, ComposableNodeContainer(
        name='harness', namespace=space, package='rclcpp_components',
        executable='component_container_mt',
        composable_node_descriptions=[
            ComposableNode(
                name='Loader', plugin='ros2_benchmark::DataLoaderNode',
                remappings=[('camera', 'loaded')], **harness),
            ComposableNode(
                name='Player', plugin='ros2_benchmark::PlaybackNode',
                parameters=[{'data_formats': ['sensor_msgs/msg/Image']}],
                remappings=[('buffer/input0', 'loaded'), ('input0', 'question')], **harness),
            ComposableNode(
                name='Monitor', plugin='ros2_benchmark::MonitorNode',
                parameters=[{'monitor_data_format': 'sensor_msgs/msg/Image'}],
                remappings=[('output', 'answer')], **harness)])]


def generate_test_description():
    return AnswerTest.generate_test_description_with_nsys(launch_setup)


class AnswerTest(ROS2BenchmarkTest):
    config = ROS2BenchmarkConfig(
        benchmark_name='Answers',
        assets_root='.',
        input_data_path='bag',
        benchmark_duration=1,
        test_iterations=1,
        playback_message_buffer_size=5,
        publisher_lower_frequency=20.0,
        publisher_upper_frequency=20.0,
        additional_fixed_publisher_rate_tests=[])

    def test_benchmark(self):
        self.run_benchmark()
'''
QUICK = (
    *("--set", "benchmark.starts=1"),
    *("--set", "benchmark.warm_up=100 ms"),
    *("--set", "benchmark.gate.interference=tolerate"),
)
LAUNCHED = (
    *QUICK,
    *("--set", "benchmark.iterations=6"),
    *("--set", "benchmark.duration=500 ms"),
    *("--set", "slos.keeps_up.require=[received > 0]"),
)


def write_program(file: Path) -> None:
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_text(NODE.format(python=sys.executable))
    file.chmod(0o755)


def test_a_spec_of_a_running_graph(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    bench = Bench(tmp_path / "bench")
    monkeypatch.chdir(bench.folder)
    write_program(Path("answer.py"))
    with reserved_domain() as domain:
        monkeypatch.setenv("ROS_DOMAIN_ID", str(domain))
        monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
        renamed = ("-r", "__ns:=/cell", "-r", "question:=/camera")
        with node_of_others([Path("answer.py").absolute(), "--ros-args", *renamed]):
            arguments = ["--from-graph", "--from-bag", "./bag", "--timeout", "60"]
            assert main(["init", "seen", *arguments]) == 0
    text = Path("seen.r2b.yaml").read_text()
    spec = yaml.safe_load(text)
    assert [each for each in validate(Path("seen.r2b.yaml")) if each.severity == "error"] == []
    assert spec["graph"]["nodes"] == {
        "answer": {
            "external": True,
            "namespace": "/cell",
            "subscribes": {"/camera": "sensor_msgs/msg/Image"},
            "publishes": {"/cell/answer": "sensor_msgs/msg/Image"},
        }
    }
    assert list(spec["playback"]["inputs"]) == ["camera"]
    assert [each["topic"] for each in spec["monitors"].values()] == ["cell/answer"]


INSPECTS_WHAT_HAS_ENDED = """
from r2bspec.harness import rclpy_tools
from r2bspec.harness.inspect_nodes import Inspector

inspector = Inspector(1.0)
inspector._wait_for_discovery = lambda: [("gone", "/cell")]
print(inspector.nodes())
rclpy_tools.finish()
"""


def test_a_node_that_ends_meanwhile_is_left_out() -> None:
    with reserved_domain() as domain:
        inspected = subprocess.run(
            [sys.executable, "-c", INSPECTS_WHAT_HAS_ENDED],
            env=os.environ | {"ROS_DOMAIN_ID": str(domain)},
            capture_output=True,
            text=True,
            timeout=HANG_S,
            check=False,
        )
    assert inspected.stdout == "[]\n", inspected.stderr


def test_without_a_graph(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    with reserved_domain() as domain:
        monkeypatch.setenv("ROS_DOMAIN_ID", str(domain))
        assert main(["init", "seen", "--from-graph", "--timeout", "1"]) == 2
    assert "there are no nodes" in capsys.readouterr().err
    assert not Path("seen.r2b.yaml").exists()


def test_a_launch_file_and_a_bag_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    bench = Bench(tmp_path / "bench")
    monkeypatch.chdir(bench.folder)
    prefix = bench.folder / "prefix"
    write_program(prefix / "lib" / "cell" / "answer")
    index = prefix / "share" / "ament_index" / "resource_index" / "packages"
    index.mkdir(parents=True)
    (index / "cell").touch()
    (prefix / "share" / "cell").mkdir()
    paths = filter(None, (str(prefix), os.environ.get("AMENT_PREFIX_PATH", "")))
    monkeypatch.setenv("AMENT_PREFIX_PATH", ":".join(paths))
    Path("cell.launch.py").write_text(LAUNCH)
    assert main(["init", "cell", "--from-launch", "cell.launch.py", "--from-bag", "./bag"]) == 0
    finished = bench.run(bench.folder / "cell.r2b.yaml", *LAUNCHED)
    finished.assert_complete()
    monitor = finished.monitor("cell_answer")
    assert monitor["sent"] == monitor["received"] > 0
    words = ["judge", str(finished.folder), "--suggest", "cell.r2b.yaml", "--write"]
    assert main([*words, *LAUNCHED]) == 0
    slos = yaml.safe_load(Path("cell.r2b.yaml").read_text())["slos"]
    # A busy machine shows no limits of latency and losses, but the work of a step.
    assert any("work.graph.p50" in text for text in slos["measured_at_30_3_hz"]["require"]), slos
    assert [each for each in validate(Path("cell.r2b.yaml")) if each.severity == "error"] == []


@only_nightly()
def test_an_imported_script_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    bench = Bench(tmp_path / "bench")
    monkeypatch.chdir(bench.folder)
    Path("answers.py").write_text(SCRIPT)
    write_program(Path("answer.py"))
    assert main(["import", "answers.py", "-o", "answers.r2b.yaml"]) == 0
    done = bench.run(bench.folder / "answers.r2b.yaml", "--var", "assets_root=.", *QUICK)
    done.assert_counts(20, "Monitor")
    (rate,) = done.result()["metrics"]["rates"]
    assert rate["offered_hz"] == 20
