"""`r2bspec import SCRIPT.py`: what is written, printed and refused."""

from __future__ import annotations

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
    for name in ("stereo_rectifier.py", "tensor_detector.py", "tracked_cups.py"):
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


def test_nothing_is_overwritten(call: Call) -> None:
    Path("a.r2b.yaml").write_text("mine")
    assert "--force" in call("import", "stereo_rectifier.py", "-o", "a.r2b.yaml", status=2).err
    assert Path("a.r2b.yaml").read_text() == "mine"
    call("import", "stereo_rectifier.py", "-o", "a.r2b.yaml", "--force", status=0)


def test_several_scripts() -> None:
    scripts = ["stereo_rectifier.py", "tracked_cups.py"]
    assert main(["import", *scripts]) == 2
    assert main(["import", *scripts, "-o", "made"]) == 0
    assert sorted(each.name for each in Path("made").iterdir()) == [
        "stereo_rectifier.r2b.yaml",
        "tracked_cups.r2b.yaml",
    ]


def test_what_cannot_be_read(call: Call) -> None:
    """It is told with its line, the other scripts are imported, and there is no stack trace."""
    os.mkfifo("pipe.py")
    Path("broken.py").write_text("import os\nx = os.nothing\n")
    said = call("import", "pipe.py", "broken.py", "stereo_rectifier.py", "-o", "made", status=1).err
    assert "pipe.py:1:1: error[R2B701" in said
    assert "broken.py:2:1: error[R2B701 script-unreadable]: AttributeError: module 'os'" in said
    assert "Traceback" not in said
    assert [each.name for each in Path("made").iterdir()] == ["stereo_rectifier.r2b.yaml"]


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


def test_a_module_that_is_missing_is_told(call: Call) -> None:
    """It is the cause of all that is wrong with the spec, so nothing else is called an error."""
    Path("helped.py").write_text(HELPED)
    said = call("import", "helped.py", "-o", "a.r2b.yaml", status=1).err
    assert said.count(": error[") == 1
    assert "helped.py:13:1: error[R2B705 script-module-missing]: cell_monitors." in said
    assert "create_monitor" in said
    assert [each for each in validate(Path("a.r2b.yaml")) if each.severity == "error"] == []
