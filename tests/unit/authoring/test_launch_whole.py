"""Launch files of which something is not known: one node of the whole file, and nothing is lost."""

from __future__ import annotations

from pathlib import Path

import pytest
import yaml

from command_line import Call
from launch_specs import made
from r2bspec.cli.main import main

CASES = yaml.safe_load(Path(__file__).with_name("first_specs.yaml").read_text(encoding="utf-8"))

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


@pytest.mark.parametrize("action", UNKNOWN.values(), ids=UNKNOWN)
def test_what_is_not_known_makes_one_node_of_the_file(action: str) -> None:
    content = CASES["sources"]["launch"].replace("ACTIONS", action)
    spec, text = made("cell.launch.py", content)
    (whole,) = spec.graph.nodes.values()
    assert whole.launch.path == "./cell.launch.py"
    assert "cell.launch.py is one launch node, because of this: " in text
    assert "#   side: left" in text
    assert "#   map: '?'" in text or "#   map: ?" in text


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
