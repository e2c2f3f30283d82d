"""A script of ros2_benchmark whose node is a Python program, imported and run."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

pytest.importorskip("rclpy")

from r2bspec.cli.main import main
from ros_runs import Bench
from ros_runs import nothing_left as nothing_left

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
NODE = """#!{python}
import rclpy
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from sensor_msgs.msg import Image

rclpy.init()
node = Node("answer")
publisher = node.create_publisher(Image, "answer", 100)
node.create_subscription(Image, "question", publisher.publish, 100)
try:
    rclpy.spin(node)
except (KeyboardInterrupt, ExternalShutdownException):
    pass
"""


def test_an_imported_script_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    bench = Bench(tmp_path / "bench")
    monkeypatch.chdir(bench.folder)
    Path("answers.py").write_text(SCRIPT)
    Path("answer.py").write_text(NODE.format(python=sys.executable))
    Path("answer.py").chmod(0o755)
    assert main(["import", "answers.py", "-o", "answers.r2b.yaml"]) == 0
    spec = bench.folder / "answers.r2b.yaml"
    finished = bench.run(
        spec,
        *("--var", "assets_root=."),
        *("--set", "benchmark.starts=1"),
        *("--set", "benchmark.warm_up=100 ms"),
        *("--set", "benchmark.gate.interference=tolerate"),
    )
    finished.assert_complete()
    (rate,) = finished.result()["metrics"]["rates"]
    assert rate["offered_hz"] == 20
    monitor = rate["pooled"]["monitors"]["Monitor"]
    assert monitor["sent"] == monitor["received"] == 20
    assert monitor["missed"] == 0
