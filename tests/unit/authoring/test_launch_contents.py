"""Everything that launch files say of what they start is in the spec, or named with its line."""

from __future__ import annotations

from pathlib import Path

from launch_specs import made, stored
from r2bspec.api import compile_plan
from r2bspec.cli.main import main


def test_containers_and_what_is_loaded_into_them() -> None:
    for name in ("contents.launch.py", "contents.launch.xml"):
        spec, _ = made(name, stored(name))
        vision = spec.containers["vision"]
        assert (vision.executable, vision.threads) == ("component_container_mt", 4)
        assert vision.prefix == ("nice", "-n", "5")
        assert vision.arguments[:3] == ("--ros-args", "--log-level", "warn")
        assert vision.env == {"RCUTILS_LOGGING_BUFFERED_STREAM": "1"}
        first, second = spec.graph.nodes["first"], spec.graph.nodes["second"]
        assert (first.container, second.container) == ("vision", "vision")
        assert (first.intra_process, second.intra_process) == (True, False)
        assert first.extra_arguments == {"forward_global_arguments": False}
        Path("made.r2b.yaml").unlink()


def test_a_parameter_of_a_container_is_an_argument_of_it() -> None:
    spec, _ = made("contents.launch.py", stored("contents.launch.py"))
    assert spec.containers["vision"].arguments[3:] == ("--ros-args", "-p", "depth:=2")


def test_groups_pass_on_what_they_set_and_keep_it_to_themselves() -> None:
    spec, _ = made("contents.launch.py", stored("contents.launch.py"))
    eye = spec.graph.nodes["eye"]
    assert eye.namespace == "/cell_left"
    assert eye.remappings == {"scan": "/laser", "image": "left/image"}
    buffered = {"RCUTILS_LOGGING_BUFFERED_STREAM": "1"}
    assert eye.env == buffered | {"CELL": "inside", "EYE": "left"}
    talker = spec.graph.nodes["talker"]
    assert (talker.namespace, talker.env, talker.remappings) == ("/late", buffered, {})


def test_arguments_and_prefixes_of_programs() -> None:
    spec, text = made("contents.launch.py", stored("contents.launch.py"))
    eye = spec.graph.nodes["eye"]
    assert eye.prefix == ("chrt", "-r", "20")
    assert eye.arguments == ("-d", "./eye.left", "--ros-args", "--log-level", "debug")
    assert spec.graph.nodes["sh"].command == ("sh", "-c", "echo  a b -p/dev/ttyACM0")
    assert "contents.launch.py:146: 'respawn' is left out: a run fails when a process ends" in text
    assert "what 'on_exit' does is left out" in text
    assert "the file gives 'talker' no name" in text


def test_parameters_have_the_types_that_launch_gives_them() -> None:
    spec, _ = made("contents.launch.py", stored("contents.launch.py"))
    share = "/opt/ros/jazzy/share/cell"
    eye = spec.graph.nodes["eye"]
    assert eye.parameter_files == (f"{share}/eye.yaml", f"{share}/more.yaml")
    assert eye.parameters == {
        "use_sim_time": True,
        "text": "10",
        "number": 10,
        "names": ["a", "b"],
        "frame": "left_link",
        "lens.f": [1.5, 2.0],
        "words": "10",
        "rate": 30,
        "mode": "fast",
    }


def test_functions_that_are_called_at_launch() -> None:
    spec, _ = made("contents.launch.py", stored("contents.launch.py"))
    for number in "12":
        camera = spec.graph.nodes[f"camera{number}"]
        assert camera.parameters == {"serial": "", "exposure": 8500}
        assert camera.arguments == ("--exposure", "8500")


def test_transitions_of_lifecycle_nodes() -> None:
    spec, text = made("contents.launch.py", stored("contents.launch.py"))
    assert spec.graph.nodes["mapper"].lifecycle == "active"
    assert "launch node" not in text


def test_the_same_in_xml() -> None:
    """Variables that are set in a group end with it."""
    spec, text = made("contents.launch.xml", stored("contents.launch.xml"))
    eye = spec.graph.nodes["eye"]
    assert eye.namespace == "/cell_left"
    assert eye.remappings == {"scan": "/laser", "image": "right/image"}
    assert eye.env["EYE"] == "right"
    assert eye.prefix == ("chrt", "-r", "20")
    assert eye.arguments == ("-d", "./eye.right", "--ros-args", "--log-level", "debug")
    assert eye.parameters == {
        "use_sim_time": True,
        "text": "10",
        "number": 10,
        "names": ["a", "b"],
        "lens.f": [1.5, 2.0],
        "rate": 30,
    }
    assert spec.graph.nodes["left_late"].namespace == ""
    assert "contents.launch.xml:37: the delay of a TimerAction is left out" in text


def test_what_is_deployed_is_in_the_plan() -> None:
    text = stored("contents.launch.xml")
    Path("a.launch.xml").write_text(
        text.replace('<param from="$(find-pkg-share cell)/', "<!--").replace('eye.yaml"/>', "-->")
    )
    assert main(["init", "made", "--from-launch", "a.launch.xml"]) == 0
    plan = compile_plan(Path("made.r2b.yaml"))
    vision = next(process for process in plan.processes if process.name == "vision")
    assert vision.argv[:7] == (
        *("nice", "-n", "5", "$(executable rclcpp_components component_container_mt)"),
        *("--ros-args", "--log-level", "warn"),
    )
    assert [node.intra_process is True for node in vision.nodes] == [True, False]
