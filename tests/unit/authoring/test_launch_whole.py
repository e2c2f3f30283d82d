"""Launch files of which something is not known: one node of the whole file, and nothing is lost."""

from __future__ import annotations

from pathlib import Path

import pytest
import yaml

from command_line import Call
from launch_specs import made

CASES = yaml.safe_load(Path(__file__).with_name("first_specs.yaml").read_text(encoding="utf-8"))

UNKNOWN = {
    "an argument": "node(arguments=['--map', LaunchConfiguration('map')])",
    "a parameter": "node(parameters=[{'robot_description': Command(['xacro ', 'a.xacro'])}])",
    "parameters of a class": "node(parameters=[MoveItConfigsBuilder('arm').to_dict()])",
    "a name": "node(name=LaunchConfiguration('map'))",
    "an environment": "node(env=open('a'))",
    "a working directory": "ExecuteProcess(cmd=['./eye'], cwd='/tmp')",
    "an action of a package": "MoveItConfigsBuilder('arm')",
    "a function": "OpaqueFunction(function=lambda context: open('a').read())",
    "what follows another": "RegisterEventHandler(OnProcessExit(target_action=node(), "
    "on_exit=[node('next')]))",
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


def test_arguments_that_no_file_has_are_refused(call: Call) -> None:
    Path("cell.launch.py").write_text(CASES["sources"]["launch"].replace("ACTIONS", "node()"))
    words = ["init", "made", "--from-launch", "cell.launch.py", "--launch-arg"]
    said = call(*words, "sade:=left", status=2).err
    assert "cell.launch.py has no launch argument 'sade'" in said
    assert "did you mean 'side'?" in said
    assert not Path("made.r2b.yaml").exists()
    call(*words, "map:=hall", status=0)
