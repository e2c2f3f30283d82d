"""Which of the programs of a process is the node that the harness joins."""

from __future__ import annotations

import pytest

from r2bspec.execute.bringup.harness_processes import Hello, is_target_process


def hello(*arguments: str, executable: str = "/usr/bin/python3.11") -> Hello:
    return Hello(pid=1, process="node", executable=executable, arguments=arguments)


@pytest.mark.parametrize(
    ("asking", "program", "meant"),
    [
        (hello("/opt/demo/talker", executable="/opt/demo/talker"), "", True),
        (hello("python3", "node.py"), "", True),
        (hello("python3", "/opt/ros/jazzy/bin/ros2", "run", "demo", "talker"), "", False),
        (hello("/usr/bin/python3", "/opt/ros/jazzy/bin/ros2", "launch", "a.py"), "", False),
        (hello("/opt/demo/talker", executable="/opt/demo/talker"), "talker", True),
        (hello("/opt/demo/other", executable="/opt/demo/other"), "talker", False),
        (hello("/opt/demo/other", "--ros-args", "-r", "__node:=talker"), "talker", True),
    ],
)
def test_a_node_is_told_from_what_starts_it(asking: Hello, program: str, meant: bool) -> None:
    assert is_target_process(asking, program) is meant
