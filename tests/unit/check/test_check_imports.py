"""What a node imports, and the messages of its topics, are looked up without executing anything."""

from __future__ import annotations

from pathlib import Path

import pytest

from example_spec import example
from r2bspec.check import check
from r2bspec.diagnostics import Diagnostic
from r2bspec.language.load_spec import load_spec
from r2bspec.plan import installed_packages as advice
from r2bspec.plan.installed_packages import missing_imports

NODE = """raise SystemExit("it was executed")
import cv_bridge_of_tests
import sibling, package_beside.part
from json.decoder import JSONDecoder
from . import relative
from r2b_test_missing.part import name
import r2b_test_missing.other
try:
    import optional_of_tests
except ImportError:
    pass
if True:
    import conditional_of_tests


def make(**kwargs):
    import lazy_of_tests
"""


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    (tmp_path / "nodes.py").write_text(NODE, encoding="utf-8")
    (tmp_path / "sibling.py").touch()
    (tmp_path / "package_beside").mkdir()
    ros = tmp_path / "ros"
    for package in ("rclpy", "sensor_msgs/msg", "std_msgs"):
        (ros / package).mkdir(parents=True)
    for package in ("rclpy", "sensor_msgs", "std_msgs"):
        (ros / package / "__init__.py").write_text("raise SystemExit('imported')\n")
    messages = "from sensor_msgs.msg._image import Image\n"
    (ros / "sensor_msgs/msg/__init__.py").write_text(messages)
    monkeypatch.syspath_prepend(str(ros))
    monkeypatch.delenv("ROS_DISTRO", raising=False)
    return tmp_path


def findings(folder: Path, text: str, *codes: str) -> list[Diagnostic]:
    file = folder / "spec.r2b.yaml"
    file.write_text(text, encoding="utf-8")
    return [each for each in check(load_spec(file), offline=True) if each.code in codes]


def test_imports_that_are_certain_and_not_found(folder: Path) -> None:
    found = missing_imports(folder / "nodes.py", folder)
    assert found == [("cv_bridge_of_tests", 2), ("r2b_test_missing", 6)]
    assert missing_imports(folder / "nothing.py", folder) == []
    assert missing_imports(folder / "nodes.py", folder / "ros") == []


def test_a_file_of_a_package_may_import_the_package_and_nothing_that_is_missing(
    folder: Path,
) -> None:
    """As colcon lays a repository out: the spec is beside the sources."""
    (folder / ".git").mkdir()
    package = folder / "src" / "blur" / "blur"
    package.mkdir(parents=True)
    (package / "__init__.py").touch()
    (package / "cost.py").touch()
    (package / "node.py").write_text("from blur.cost import work\nimport blurr_of_tests\n")
    bench = folder / "bench"
    bench.mkdir()
    topics = "subscribes: {image: sensor_msgs/msg/Image}"
    node = f"{{python: '../src/blur/blur/node.py:Blur', {topics}}}"
    (missing,) = findings(bench, example(graph=f"nodes: {{one: {node}}}"), "R2B680")
    assert "imports 'blurr_of_tests' in line 2" in missing.message


def test_an_import_is_named_with_its_line_and_the_way_to_install_it(folder: Path) -> None:
    (folder / "nodes.py").write_text("import cv2_of_tests\nimport nav9_msgs\n", encoding="utf-8")
    topics = "subscribes: {image: sensor_msgs/msg/Image}"
    text = example(graph=f"nodes: {{one: {{python: './nodes.py:make', {topics}}}}}")
    one, two = findings(folder, text, "R2B680")
    assert one.message == (
        "'./nodes.py' imports 'cv2_of_tests' in line 1, which is not found on this machine"
    )
    assert one.severity == "warning"
    assert one.certainty == "environment"
    assert two.help == (
        "sudo apt install ros-jazzy-nav9-msgs, or source the workspace that contains it"
    )


@pytest.mark.parametrize(
    ("module", "help_text"),
    [
        ("cv2", "sudo apt install python3-opencv, or pip install opencv-python-headless"),
        ("torch", "pip install torch"),
        ("message_filters", "sudo apt install ros-jazzy-message-filters"),
        ("cv_bridge", "sudo apt install ros-jazzy-cv-bridge, or source the workspace"),
        ("unheard_of", "install it with pip, or source the workspace"),
    ],
)
def test_the_way_to_install_a_module(
    module: str, help_text: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("ROS_DISTRO", raising=False)
    assert advice.python_module_advice(module).startswith(help_text)


@pytest.mark.parametrize(
    ("kind", "message", "help_text"),
    [
        ("sensor_msgs/msg/Image", "", ""),
        (
            "our9_msgs/msg/Thing",
            "message type 'our9_msgs/msg/Thing' is not installed on this machine",
            "sudo apt install ros-jazzy-our9-msgs, or source",
        ),
        (
            "sensor_msgs/msg/Imu",
            (
                "message type 'sensor_msgs/msg/Imu' is not installed on this machine: its package "
                "sensor_msgs has no such message"
            ),
            "build the version of sensor_msgs that has it",
        ),
        ("std_msgs/msg/String", "", ""),
    ],
)
def test_message_types_of_the_harness_are_looked_up(
    folder: Path, kind: str, message: str, help_text: str
) -> None:
    text = example(
        graph="nodes: {one: {python: './nodes.py:make'}}",
        monitors=f"{{output: {{topic: output, format: {kind}, match: order}}}}",
    )
    found = findings(folder, text, "R2B681")
    assert [each.message for each in found] == ([message] if message else [])
    assert all(each.help.startswith(help_text) for each in found)


def test_a_clock_is_needed_by_a_node_that_uses_it(folder: Path) -> None:
    relay = "python: r2bspec.nodes.RelayNode, remappings: {input: image}"
    graph = f"nodes: {{relay: {{{relay}, parameters: {{use_sim_time: true}}}}}}"
    [found] = findings(folder, example(graph=graph), "R2B233")
    assert found.severity == "warning"
    assert "playback: {clock: true}" in found.help
    inputs = "inputs: {image: {from: image_raw, format: sensor_msgs/msg/Image}}"
    with_clock = example(graph=graph, playback=f"{{clock: true, {inputs}}}")
    assert findings(folder, with_clock, "R2B233") == []
    source = "{command: [sh, ./x.sh], publishes: {/clock: rosgraph_msgs/msg/Clock}}"
    own = example(graph=graph.replace("nodes: {", f"nodes: {{source: {source}, "))
    assert findings(folder, own, "R2B233") == []
    unknown = example(graph=graph.replace("nodes: {", "nodes: {source: {command: [sh, ./x.sh]}, "))
    [found] = findings(folder, unknown, "R2B233")
    assert (found.severity, "nothing known publishes" in found.message) == ("info", True)


def test_a_live_benchmark_publishes_no_clock(folder: Path) -> None:
    text = """
r2bspec: 1
name: live
playback: {mode: live, clock: true}
graph: {nodes: {relay: {python: r2bspec.nodes.RelayNode}}}
monitors: {out: {topic: output, format: sensor_msgs/msg/Image}}
benchmark: {duration: 10 s}
"""
    file = folder / "live.r2b.yaml"
    file.write_text(text, encoding="utf-8")
    assert "'playback.clock' has no effect: a live benchmark plays nothing" in {
        diagnostic.message for diagnostic in load_spec(file).diagnostics
    }
