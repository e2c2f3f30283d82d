"""Launch files of which something is not known: one node of the whole file, and nothing is lost."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from command_line import Call
from launch_specs import made
from r2bspec.cli.main import main

HEAD = """
from launch import LaunchDescription
from launch.actions import *
from launch.conditions import IfCondition
from launch.event_handlers import OnProcessExit
from launch.launch_description_sources import PythonLaunchDescriptionSource
from launch.substitutions import *
from launch_ros.actions import *
from launch_ros.descriptions import *
from moveit_configs_utils import MoveItConfigsBuilder
from nav2_common.launch import RewrittenYaml
import os


def node(name='eye', **more):
    return Node(package='cell', executable='eye', name=name, **more)


def launch(actions):
    return LaunchDescription([
        DeclareLaunchArgument('side', default_value='left', choices=['left', 'right']),
        DeclareLaunchArgument('map'), *actions])
"""

UNKNOWN = {
    "a condition": "node(condition=IfCondition(EnvironmentVariable('CELL_MODE')))",
    "an argument": "node(arguments=['--map', LaunchConfiguration('map')])",
    "a remapping": "node(remappings=[('image', LaunchConfiguration('map'))])",
    "a parameter": "node(parameters=[{'robot_description': Command(['xacro ', 'a.xacro'])}])",
    "a parameter file": "node(parameters=[RewrittenYaml(source_file='a.yaml')])",
    "a rewritten file": "node(parameters=[ParameterFile('a.yaml', allow_substs=True)])",
    "parameters of a class": "node(parameters=[MoveItConfigsBuilder('arm').to_dict()])",
    "a name": "node(name=LaunchConfiguration('map'))",
    "a program": "Node(package='cell', executable=LaunchConfiguration('map'))",
    "an environment variable": "node(additional_env={'A': LaunchConfiguration('map')})",
    "an environment": "node(env=open('a'))",
    "a default": "node(parameters=[{'a': EnvironmentVariable('A', default_value='3')}])",
    "a working directory": "ExecuteProcess(cmd=['./eye'], cwd='/tmp')",
    "an action of a package": "MoveItConfigsBuilder('arm')",
    "a function": "OpaqueFunction(function=lambda context: open('a').read())",
    "what follows another": "RegisterEventHandler(OnProcessExit(target_action=node(), "
    "on_exit=[node('next')]))",
    "a container of a package": "ComposableNodeContainer(name='c', namespace='', package='cell', "
    "executable='own_container', composable_node_descriptions=[])",
    "an effect": "node(name=os.system('make') or 'eye')",
    "nothing": "LogInfo(msg='hello')",
}


def made_in_python(action: str, *arguments: str) -> tuple[Any, str]:
    """The spec of a launch file in Python with an action."""
    function = f"def generate_launch_description():\n    return launch([{action}])\n"
    return made("cell.launch.py", f"{HEAD}\n{function}", *arguments)


@pytest.mark.parametrize("action", UNKNOWN.values(), ids=UNKNOWN)
def test_what_is_not_known_makes_one_node_of_the_file(action: str) -> None:
    spec, text = made_in_python(action)
    (whole,) = spec.graph.nodes.values()
    assert whole.launch.path == "./cell.launch.py"
    assert "cell.launch.py is one launch node, because of this: " in text
    assert "#   side: left" in text
    assert "#   map: '?'" in text or "#   map: ?" in text


def test_a_copy_of_the_environment_is_what_is_added_to_it() -> None:
    """The programs of a run have its environment, so that nothing else is to be said."""
    body = "    env = os.environ.copy()\n    env['A'] = '2'\n    env['B'] = env['HOME']\n"
    content = (
        f"{HEAD}\ndef generate_launch_description():\n{body}    return launch([node(env=env)])\n"
    )
    spec, text = made("cell.launch.py", content)
    assert "env: {A: '2', B: $(env HOME)}" in text
    assert "of launch has no other variables" not in text
    assert [node.launch for node in spec.graph.nodes.values()] == [None]


def test_arguments_that_are_given_decide() -> None:
    action = "node(name=LaunchConfiguration('map'), namespace=LaunchConfiguration('side'))"
    spec, _ = made_in_python(action, "--launch-arg", "map:=hall", "--launch-arg", "side:=right")
    assert spec.graph.nodes["hall"].namespace == "/right"


def test_arguments_that_are_given_are_those_of_the_whole_file() -> None:
    action = "node(name=LaunchConfiguration('map'), cwd='/tmp')"
    spec, _ = made_in_python(action, "--launch-arg", "map:=0012", "--launch-arg", "fast:=True")
    assert spec.graph.nodes["cell"].launch.arguments == {"map": "0012", "fast": "True"}


@pytest.mark.parametrize("default", ['default="1"', ""])
def test_arguments_that_no_file_has_are_refused(
    default: str, capsys: pytest.CaptureFixture[str]
) -> None:
    content = f'<arg name="period" {default}/><node pkg="cell" exec="eye" name="n$(var period)"/>'
    Path("cell.launch.xml").write_text(f"<launch>{content}</launch>")
    words = ["init", "made", "--from-launch", "cell.launch.xml", "--launch-arg"]
    assert main([*words, "perod:=0.5"]) == 2
    said = capsys.readouterr().err
    assert "cell.launch.xml has no launch argument 'perod'" in said
    assert "did you mean 'period'?" in said
    assert not Path("made.r2b.yaml").exists()
    assert main([*words, "speed:=0.5"]) == (2 if default else 0)
    assert "its arguments: 'period'" in capsys.readouterr().err
    Path("made.r2b.yaml").unlink(missing_ok=True)
    assert main([*words, "period:=5"]) == 0


@pytest.mark.parametrize(
    ("action", "is_told"),
    [
        ("node(cwd='/tmp')", True),
        ("IncludeLaunchDescription('/opt/far/far.launch.py'), node()", True),
        ("node(name=LaunchConfiguration('sade', default='eye'))", False),
    ],
)
def test_arguments_that_another_file_may_have_are_told(action: str, *, is_told: bool) -> None:
    """One that is used, and not declared, is known as well."""
    function = f"def generate_launch_description():\n    return launch([{action}])\n"
    Path("cell.launch.py").write_text(f"{HEAD}\n{function}")
    words = ("--from-launch", "cell.launch.py", "--launch-arg", "sade:=up")
    assert main(["init", "made", *words]) == 0
    text = Path("made.r2b.yaml").read_text()
    told = "has no launch argument 'sade' that is known; did you mean 'side'?"
    assert (told in text.replace("\n# ", " ")) == is_told


def test_a_value_that_is_no_choice_is_told() -> None:
    _, text = made_in_python("node()", "--launch-arg", "side:=up")
    assert "'up' is no choice of the launch argument 'side': left, right" in text


def test_only_the_included_file_is_kept_whole() -> None:
    """It gets the arguments of the file above it, too, as it does from launch."""
    Path("robot.launch.xml").write_text(
        '<launch><arg name="model"/><node pkg="robot" exec="state" name="state">'
        '<param name="robot_description" value="$(command \'xacro a\')"/></node></launch>'
    )
    content = """<launch>
      <arg name="sim" default="True"/>
      <set_env name="CELL" value="3"/>
      <include file="$(dirname)/robot.launch.xml"><arg name="model" value="007"/></include>
      <node pkg="cell" exec="eye" name="eye"/>
    </launch>"""
    spec, text = made("cell.launch.xml", content)
    whole = spec.graph.nodes["robot"]
    assert list(spec.graph.nodes) == ["eye", "robot"]
    assert whole.launch.path == "./robot.launch.xml"
    assert whole.launch.arguments == {"model": "007", "sim": "True"}
    assert whole.env == {"CELL": "3"}
    assert "robot.launch.xml:1:71" not in text
    assert "# - robot.launch.xml:1: robot.launch.xml is one launch node" in text


def test_an_argument_that_is_not_known_is_not_passed_on_in_silence() -> None:
    content = """<launch>
      <arg name="vehicle" default="$(env CELL_VEHICLE truck)"/>
      <include file="$(find-pkg-share far_away)/launch/far.launch.xml"/>
    </launch>"""
    spec, text = made("cell.launch.xml", content)
    assert spec.graph.nodes["far"].launch.package == "far_away"
    assert "cell.launch.xml:3: far.launch.xml gets no launch argument 'vehicle'" in text


def test_names_that_a_run_needs_itself_are_not_taken() -> None:
    content = '<launch><node pkg="cell" exec="system" name="system"/></launch>'
    spec, text = made("system.launch.xml", content)
    assert list(spec.graph.nodes) == ["system_2"]
    assert "here it is 'system_2'" in text


def test_programs_that_end_are_told() -> None:
    content = '<launch><node pkg="controller_manager" exec="spawner" name="arm"/></launch>'
    _, text = made("cell.launch.xml", content)
    assert "'spawner' ends when it has done its work" in text


def test_places_in_markup_are_those_of_the_entity(call: Call) -> None:
    Path("a.launch.yaml").write_text("launch:\n- log: {message: hi}\n- fly: {to: moon}\n")
    error = call("init", "made", "--from-launch", "a.launch.yaml", status=0).err
    assert "a.launch.yaml:3:8: info[R2B711" in error
    assert "<fly> has no form in a spec" in error


@pytest.mark.parametrize("written", ["map", ":=3"])
def test_what_is_no_launch_argument_is_refused(written: str, call: Call) -> None:
    Path("a.launch.xml").write_text("<launch/>")
    error = call("init", "made", "--from-launch", "a.launch.xml", "--launch-arg", written, status=2)
    assert "NAME:=VALUE" in error.err
    assert not Path("made.r2b.yaml").exists()


def test_arguments_of_an_included_file_apply_after_it() -> None:
    """Without a group, launch keeps them: later files get them, and later actions of the file."""
    Path("low.launch.xml").write_text(
        '<launch><arg name="speed"/><arg name="lens" default="3"/>'
        '<node pkg="cell" exec="eye" name="eye_$(var speed)_$(var lens)"/></launch>'
    )
    include = '<include file="$(dirname)/low.launch.xml"><arg name="speed" value="{}"/>{}</include>'
    two = include.format("1", "") + include.format("2", '<arg name="lens" value="7"/>')
    spec, _ = made("cell.launch.xml", f"<launch>{two}{include.format('3', '')}</launch>")
    assert list(spec.graph.nodes) == ["eye_1_3", "eye_2_7", "eye_3_7"]
    Path("made.r2b.yaml").unlink()
    after = '<node pkg="cell" exec="eye" name="$(var speed)"/>'
    declared = f'<launch><arg name="speed" default="9"/>{include.format("1", "")}'
    _, text = made("cell.launch.xml", f"{declared}{after}</launch>")
    assert "the launch argument 'speed' has the value of an included file here" in text
    Path("made.r2b.yaml").unlink()
    group = f'<arg name="speed" default="n9"/><group>{include.format("1", "")}</group>'
    spec, _ = made("cell.launch.xml", f"<launch>{group}{after}</launch>")
    assert list(spec.graph.nodes) == ["eye_1_3", "n9"]
