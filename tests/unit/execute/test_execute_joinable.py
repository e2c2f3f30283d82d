"""Which of the programs of a process is the node that the harness joins."""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import time
from contextlib import closing
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from plans import process_plan
from r2bspec.execute.bringup.harness_processes import (
    GraphJoins,
    Hello,
    is_target_process,
    program_name,
)
from r2bspec.execute.errors import NotJoinableError
from r2bspec.plan.plan import JoinPlan


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
    if meant and program:
        assert program_name(asking) == program


def test_several_programs_of_one_process_are_refused(tmp_path: Path) -> None:
    supervisor: Any = SimpleNamespace(pump=time.sleep)
    joins = GraphJoins(supervisor, tmp_path, Path("preloaded.so"), Path("harness.so"))
    launch = subprocess.Popen(["/bin/sh", "-c", "sleep 600 & sleep 600"], start_new_session=True)
    child: Any = SimpleNamespace(name="stack", pid=launch.pid)
    asking = [socket.socket(socket.AF_UNIX) for _ in range(2)]
    try:
        with closing(joins), pytest.raises(NotJoinableError, match="several programs") as refused:
            for program in asking:
                program.connect(str(tmp_path / "join.socket"))
                program.sendall(b"process stack\n")
            joins.join(child, process_plan("stack", join=JoinPlan(player=True)), 60)
        assert refused.value.blamed == "stack"
        assert "in: stack/" in refused.value.hint
    finally:
        os.killpg(launch.pid, signal.SIGKILL)
        launch.wait()
        for program in asking:
            program.close()
