"""What this machine has is looked up without importing or starting anything."""

from __future__ import annotations

import contextlib
import os
import subprocess
import sys
from pathlib import Path

import pytest
from check_specs import codes, findings

from example_spec import example
from r2bspec.diagnostics import Certainty
from r2bspec.plan.installed_packages import ros_package_advice, top_level_names
from r2bspec.plan.this_machine import find_module

KNOWN = "subscribes: {image: sensor_msgs/msg/Image}, publishes: {output: sensor_msgs/msg/Image}"


def node(text: str) -> str:
    return example(graph=f"nodes: {{detector: {{{text}, {KNOWN}}}}}")


@pytest.fixture
def workspace(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with an ament package, a Python package, and programs; the current folder."""
    index = tmp_path / "ros" / "share/ament_index/resource_index/packages"
    index.mkdir(parents=True)
    (index / "detectors").touch()
    programs = tmp_path / "ros" / "lib" / "detectors"
    programs.mkdir(parents=True)
    (programs / "detector_node").touch(mode=0o755)
    (programs / "notes.txt").touch(mode=0o644)
    package = tmp_path / "site" / "r2b_test_nodes"
    package.mkdir(parents=True)
    (package / "__init__.py").write_text("raise SystemExit('imported')\n", encoding="utf-8")
    (package / "detector.py").write_text("class Detector: ...\n", encoding="utf-8")
    monkeypatch.setenv("AMENT_PREFIX_PATH", f"{tmp_path / 'ros'}:{tmp_path / 'nowhere'}")
    monkeypatch.syspath_prepend(str(tmp_path / "site"))
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.usefixtures("workspace")
def test_modules_are_found_below_packages_that_are_not_imported() -> None:
    found = find_module("r2b_test_nodes.detector")
    assert found is not None
    assert (found.origin or "").endswith("detector.py")
    assert find_module("r2b_test_nodes.other") is None
    assert find_module("r2b_test_nodes.detector.deeper") is None
    assert find_module("r2b_test_no_such") is None
    assert "r2b_test_nodes" not in sys.modules


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
    # That 'elsewhere' is not installed is another matter.
    found = [
        each for each in findings(node("python: './nodes.py:Detector'")) if each.code != "R2B680"
    ]
    assert [each.code for each in found] == expected
    assert all(each.severity == "error" for each in found)


def test_a_file_that_is_not_there_or_not_beside_the_spec(workspace: Path) -> None:
    assert codes(node("python: './nodes.py:Detector'")) == ["R2B624"]
    inside = workspace / "inside"
    inside.mkdir()
    (workspace / "nodes.py").write_text("not python at all", encoding="utf-8")
    text = node("python: '../nodes.py:Detector'")
    assert codes(text, file="inside/spec.r2b.yaml") == [], "it is there, but it is not read"


def test_files_that_tell_nothing(tmp_path: Path) -> None:
    file = tmp_path / "nodes.py"
    assert top_level_names(file) is None
    file.write_bytes(b"x = 1\n" * 300_000)
    assert top_level_names(file) is None
    file.write_bytes(b"(" * 100_000)
    with contextlib.suppress(SyntaxError):
        assert top_level_names(file) is None


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


@pytest.mark.usefixtures("workspace")
def test_a_package_of_the_distribution_is_named_as_ubuntu_has_it(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.delenv("ROS_DISTRO", raising=False)
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
