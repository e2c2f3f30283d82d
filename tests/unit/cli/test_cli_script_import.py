"""`r2bspec import SCRIPT.py`: what is written, printed and refused."""

from __future__ import annotations

import json
import os
import shutil
from pathlib import Path

import pytest

from command_line import Call
from r2bspec.api import validate
from r2bspec.cli.main import main

CORPUS = Path(__file__).parents[2] / "golden" / "script_import" / "scripts"


@pytest.fixture(autouse=True)
def _folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("stereo_rectifier.py", "mistaken_stereo.py", "tensor_detector.py"):
        shutil.copy(CORPUS / name, tmp_path)
    monkeypatch.chdir(tmp_path)


def test_printed_and_written(call: Call) -> None:
    printed = call("import", "stereo_rectifier.py", status=0).out
    ended = call("import", "stereo_rectifier.py", "-o", "a.r2b.yaml", status=0)
    assert "wrote a.r2b.yaml" in ended.err
    assert Path("a.r2b.yaml").read_text() == printed
    assert [each for each in validate(Path("a.r2b.yaml")) if each.severity == "error"] == []


def test_paths_are_relative_to_the_spec() -> None:
    Path("detector.yaml").write_text("/**: {ros__parameters: {a: 1}}")
    assert main(["import", "tensor_detector.py", "-o", "a.r2b.yaml"]) == 0
    assert "script_folder: .\n" in Path("a.r2b.yaml").read_text()
    Path("specs").mkdir()
    assert main(["import", "tensor_detector.py", "-o", "specs"]) == 0
    assert "script_folder: .." in Path("specs/tensor_detector.r2b.yaml").read_text()


def test_an_error_of_the_spec_is_told(call: Call) -> None:
    assert "R2B614" in call("import", "tensor_detector.py", "-o", "a.r2b.yaml", status=1).err


def test_nothing_is_overwritten(call: Call) -> None:
    Path("a.r2b.yaml").write_text("mine")
    assert "--force" in call("import", "stereo_rectifier.py", "-o", "a.r2b.yaml", status=2).err
    assert Path("a.r2b.yaml").read_text() == "mine"
    call("import", "stereo_rectifier.py", "-o", "a.r2b.yaml", "--force", status=0)


def test_several_scripts() -> None:
    scripts = ["stereo_rectifier.py", "mistaken_stereo.py"]
    assert main(["import", *scripts]) == 2
    assert main(["import", *scripts, "-o", "made"]) == 0
    assert sorted(each.name for each in Path("made").iterdir()) == [
        "mistaken_stereo.r2b.yaml",
        "stereo_rectifier.r2b.yaml",
    ]


def test_check(call: Call) -> None:
    call("import", "--check", "tensor_detector.py", status=0)
    found = json.loads(
        call("import", "--check", "--format", "json", "mistaken_stereo.py", status=1).out
    )["findings"]
    place = [(each["line"], each["column"]) for each in found if each["code"] == "R2B723"]
    assert place == [(17, 43)]
    assert not list(Path().glob("*.r2b.yaml"))


@pytest.mark.parametrize("output_format", ["text", "json", "github", "sarif", "junit"])
def test_formats(output_format: str, call: Call) -> None:
    ended = call("import", "--check", "--format", output_format, "mistaken_stereo.py", status=1)
    assert "R2B721" in ended.out


def test_what_cannot_be_read(call: Call) -> None:
    os.mkfifo("pipe.py")
    Path("large.py").write_text("x = 1\n" * 60_000)
    Path("latin.py").write_bytes(b"import a\n# \xe9\n")
    Path("broken.py").write_text("import a\nx = (1\n")
    for name, code in (
        ("pipe.py", "R2B701"),
        ("large.py", "R2B701"),
        ("latin.py", "R2B701"),
        ("missing.py", "R2B701"),
        ("broken.py", "R2B702"),
    ):
        assert code in call("import", name, status=1).err


def test_reports_are_told_apart_by_content(call: Call) -> None:
    Path("report.py").write_text('{"BasicPerformanceMetrics.NUM_FRAMES_SENT": 3}')
    assert "a report of ros2_benchmark" in call("import", "report.py", status=0).out
    call("import", "report.py", "--check", status=2)
    call("import", "report.py", "stereo_rectifier.py", status=2)
    shutil.copy("stereo_rectifier.py", "script")
    call("import", "script", status=0)


HELPED = """
from cell_monitors import MonitorUtility
from launch_ros.actions import ComposableNodeContainer
from launch_ros.descriptions import ComposableNode
from ros2_benchmark import ROS2BenchmarkConfig, ROS2BenchmarkTest

UTILITY = MonitorUtility()

def launch_setup(prefix, timeout):
    own = ComposableNode(name='own', package='cell', plugin='cell::Own')
    return [ComposableNodeContainer(
        name='all', package='rclcpp_components', executable='component_container',
        composable_node_descriptions=[own, UTILITY.create_monitor('far', topic='done')])]

def generate_test_description():
    return HelpedTest.generate_test_description_with_nsys(launch_setup)

class HelpedTest(ROS2BenchmarkTest):
    config = ROS2BenchmarkConfig(benchmark_name='Helped', benchmark_mode='LIVE')
"""
HELPER = """
from launch_ros.descriptions import ComposableNode

class MonitorUtility:
    def create_monitor(self, name, topic):
        return ComposableNode(
            name=name, package='ros2_benchmark', plugin='ros2_benchmark::MonitorNode',
            parameters=[{'monitor_data_format': 'sensor_msgs/msg/Image'}],
            remappings=[('output', topic)])
"""


def test_a_module_that_is_missing_is_told(call: Call) -> None:
    """It is the cause of all that is wrong with the spec, so nothing else is called an error."""
    Path("helped.py").write_text(HELPED)
    said = call("import", "helped.py", "-o", "a.r2b.yaml", status=1).err
    assert said.count(": error[") == 1
    assert "helped.py:2:1: error[R2B705 script-module-missing]: the module 'cell_monitors'" in said
    assert "create_monitor" in said
    assert [each for each in validate(Path("a.r2b.yaml")) if each.severity == "error"] == []


def test_a_module_in_a_named_folder_is_read() -> None:
    Path("helped.py").write_text(HELPED)
    Path("elsewhere").mkdir()
    Path("elsewhere/cell_monitors.py").write_text(HELPER)
    words = ["import", "helped.py", "--package-path", "elsewhere", "-o", "a.r2b.yaml"]
    assert main(words) == 0
    assert "topic: /done" in Path("a.r2b.yaml").read_text()
