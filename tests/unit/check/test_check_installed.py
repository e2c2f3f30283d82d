"""What this machine has, and what nodes import, is looked up without executing anything."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest
from check_specs import codes, findings

from ament_packages import install_package
from example_spec import example
from r2bspec.check import check
from r2bspec.diagnostics import Certainty, Diagnostic
from r2bspec.language.load_spec import load_spec
from r2bspec.plan.package_advice import ros_package_advice

# What this machine has is looked up without importing or starting anything.


KNOWN = "subscribes: {image: sensor_msgs/msg/Image}, publishes: {output: sensor_msgs/msg/Image}"


def node(text: str) -> str:
    return example(graph=f"nodes: {{detector: {{{text}, {KNOWN}}}}}")


@pytest.fixture(autouse=True)
def sourced(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ROS_DISTRO", "jazzy")


@pytest.fixture
def workspace(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with an ament package, a Python package, and programs; the current folder."""
    install_package(tmp_path / "ros", "detectors", programs=["detector_node"])
    (tmp_path / "ros/lib/detectors/notes.txt").touch(mode=0o644)
    package = tmp_path / "site" / "r2b_test_nodes"
    package.mkdir(parents=True)
    (package / "__init__.py").write_text("raise SystemExit('imported')\n", encoding="utf-8")
    (package / "detector.py").write_text("class Detector: ...\n", encoding="utf-8")
    monkeypatch.setenv("AMENT_PREFIX_PATH", f"{tmp_path / 'ros'}:{tmp_path / 'nowhere'}")
    monkeypatch.syspath_prepend(str(tmp_path / "site"))
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_an_interpreter_that_ignores_its_environment_finds_what_processes_will_find(
    tmp_path: Path,
) -> None:
    (tmp_path / "my_package_of_nodes.py").write_text("")
    code = (
        f"import sys; sys.path.insert(0, {str(Path(__file__).parents[3])!r})\n"
        "from r2bspec.plan.this_machine import find_module\n"
        "print(find_module('my_package_of_nodes').origin, find_module('json').name)"
    )
    done = subprocess.run(
        [sys.executable, "-I", "-c", code],
        env={**os.environ, "PYTHONPATH": f":{tmp_path}:"},
        capture_output=True,
        text=True,
        check=True,
    )
    assert done.stdout.split() == [str(tmp_path / "my_package_of_nodes.py"), "json"]


@pytest.mark.parametrize(
    ("target", "expected"),
    [
        ("r2b_test_nodes.detector.Detector", []),
        ("r2b_test_nodes.detector.Detektor", ["R2B625"]),
        ("r2b_test_nodes.other.Detector", ["R2B624"]),
        ("r2b_test_no_such.Detector", ["R2B624"]),
    ],
)
@pytest.mark.usefixtures("workspace")
def test_installed_nodes(target: str, expected: list[str]) -> None:
    found = findings(node(f"python: {target}"))
    assert [each.code for each in found] == expected
    assert all(each.severity == "warning" for each in found)
    assert all(each.certainty is Certainty.ENVIRONMENT for each in found)


@pytest.mark.parametrize(
    ("source", "expected"),
    [
        ("class Detector: ...", []),
        ("def Detector(**kwargs): ...", []),
        ("from elsewhere import Detector", []),
        ("from elsewhere import *", []),
        ("def __getattr__(name): ...", []),
        ("try:\n    from fast import Detector\nexcept ImportError:\n    Detector = None", []),
        ("if True:\n    class Detector: ...", []),
        ("Detector = make()", []),
        ("(Detector, other) = make()", []),
        ("class Detektor: ...", ["R2B625"]),
        ("def f():\n    class Detector: ...", ["R2B625"]),
        ("class Detector", ["R2B624"]),
    ],
)
def test_nodes_in_a_file_beside_the_spec(source: str, expected: list[str], workspace: Path) -> None:
    (workspace / "nodes.py").write_text(source, encoding="utf-8")
    found = findings(node("python: './nodes.py:Detector'"))
    assert [each.code for each in found] == expected
    assert all(each.severity == "error" for each in found)


def test_a_file_that_is_not_there_or_not_beside_the_spec(workspace: Path) -> None:
    assert codes(node("python: './nodes.py:Detector'")) == ["R2B624"]
    inside = workspace / "inside"
    inside.mkdir()
    (workspace / "nodes.py").write_text("not python at all", encoding="utf-8")
    text = node("python: '../nodes.py:Detector'")
    assert codes(text, file="inside/spec.r2b.yaml") == [], "it is there, but it is not read"


@pytest.mark.parametrize(
    ("target", "advice"),
    [
        ("./node.py:Detector", "did you mean './nodes.py'?"),
        ("my_nodes.Detector", "for the file beside the spec, write ./my_nodes.py:Detector"),
        ("inside.graph.Detector", "write ./inside/graph.py:Detector"),
        ("inside/grap.py:Detector", "did you mean 'inside/graph.py'?"),
        ("nothing_of_this_name.Detector", "install it, or source its workspace"),
    ],
)
def test_a_wrong_target_is_answered_with_the_file_that_is_there(
    target: str, advice: str, workspace: Path
) -> None:
    (workspace / "inside").mkdir()
    for file in ("nodes.py", "my_nodes.py", "inside/graph.py"):
        (workspace / file).write_text("class Detector: ...", encoding="utf-8")
    (found,) = findings(node(f"python: '{target}'"))
    assert advice in found.help


@pytest.mark.parametrize(
    ("kind", "expected"),
    [
        ("package: detectors, executable: detector_node", []),
        ("package: detectors, executable: detector_nod", ["R2B623"]),
        ("package: detectors, executable: notes.txt", ["R2B623"]),
        ("package: detector, executable: detector_node", ["R2B622"]),
        ("command: [./run.sh]", ["R2B621"]),
        ("command: [r2b-test-no-such]", ["R2B621"]),
        ("command: [ros/lib/detectors/detector_node]", []),
    ],
)
@pytest.mark.usefixtures("workspace")
def test_programs(kind: str, expected: list[str]) -> None:
    found = findings(node(kind))
    assert [each.code for each in found] == expected
    assert all(each.certainty is Certainty.ENVIRONMENT for each in found)


@pytest.mark.parametrize(
    ("folder", "expected"), [("detector", ["R2B622"]), ("detectors", ["R2B614"])]
)
def test_a_parameter_file_of_a_package_that_is_missing(
    workspace: Path, folder: str, expected: list[str]
) -> None:
    """What is missing is the package: another machine may have it, as with its executables."""
    file = workspace / "ros" / "share" / folder / "config" / "one.yaml"
    found = findings(node(f"package: detectors, executable: detector_node, parameters: {file}"))
    assert [each.code for each in found] == expected
    assert [each.certainty is Certainty.ENVIRONMENT for each in found] == [folder == "detector"]


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        ("detectors, detector_node", []),
        ("detectors, detector_nod", ["R2B623"]),
        ("detector, detector_node", ["R2B622"]),
        ("--prefix, gdb, detector", []),
    ],
)
@pytest.mark.usefixtures("workspace")
def test_what_ros2_runs_is_looked_up(words: str, expected: list[str]) -> None:
    found = findings(node(f"command: [ros2, run, {words}]"))
    # ros2 itself may be there.
    assert [each.code for each in found if each.code != "R2B621"] == expected


@pytest.mark.usefixtures("workspace")
def test_a_package_of_the_distribution_is_named_as_ubuntu_has_it(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    text = example(
        graph="""
            nodes:
              one: {package: image_proc, plugin: "image_proc::RectifyNode"}
              two: {package: image_proc, plugin: "image_proc::ResizeNode"}
              three: {package: image_prok, executable: node}
              four: {package: our_own, executable: node}
        """
    )
    found = [each for each in findings(text) if each.code == "R2B622"]
    assert [each.help.partition(" (")[0] for each in found] == [
        "sudo apt install ros-jazzy-image-proc, or source the workspace that contains it",
        "did you mean 'image_proc'?",
        (
            "source the workspace that contains it; if it is a released package: "
            "sudo apt install ros-jazzy-our-own"
        ),
    ]
    assert [each.message for each in found[0].related] == ["also used here"]


def test_the_distribution_is_that_of_the_environment(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ROS_DISTRO", "kilted")
    assert "apt install ros-kilted-image-proc" in ros_package_advice("image_proc")
    monkeypatch.setenv("ROS_DISTRO", "no; rm")
    assert "apt install ros-jazzy-image-proc" in ros_package_advice("image_proc")


# What a node imports, and the messages of its topics, are looked up without executing anything.


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
        monkeypatch.delitem(sys.modules, package, raising=False)
    messages = "from sensor_msgs.msg._image import Image\n"
    (ros / "sensor_msgs/msg/__init__.py").write_text(messages)
    monkeypatch.syspath_prepend(str(ros))
    return tmp_path


def findings_of(folder: Path, text: str, *codes: str) -> list[Diagnostic]:
    file = folder / "spec.r2b.yaml"
    file.write_text(text, encoding="utf-8")
    return [each for each in check(load_spec(file), offline=True) if each.code in codes]


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
    found = findings_of(folder, text, "R2B681")
    assert [each.message for each in found] == ([message] if message else [])
    assert all(each.help.startswith(help_text) for each in found)


def test_wheels_are_advised_where_they_exist(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("r2bspec.plan.package_advice.has_wheels", lambda: True)
    monkeypatch.delenv("ROS_DISTRO", raising=False)
    assert ros_package_advice("nav_msgs") == "pip install ros-jazzy-nav-msgs"
    assert ros_package_advice("tf2_ros").startswith("there is no wheel of tf2_ros: source a ROS 2")
    assert "pip" not in ros_package_advice("our_own")


def test_a_clock_may_come_from_a_node(folder: Path) -> None:
    relay = "{python: r2bspec.nodes.RelayNode, parameters: {use_sim_time: true}}"
    graph = f"nodes: {{source: SOURCE, relay: {relay}}}"
    source = "{command: [sh, ./x.sh], publishes: {/clock: rosgraph_msgs/msg/Clock}}"
    assert findings_of(folder, example(graph=graph.replace("SOURCE", source)), "R2B233") == []
    unknown = example(graph=graph.replace("SOURCE", "{command: [sh, ./x.sh]}"))
    [found] = findings_of(folder, unknown, "R2B233")
    assert (found.severity, "nothing known publishes" in found.message) == ("info", True)
