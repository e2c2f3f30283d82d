"""The launch file of a deployment, carried out with stand-ins for launch and launch_ros."""

from __future__ import annotations

import ast
import json
import subprocess
import sys
from pathlib import Path

import msgspec
import pytest

from launch_stand_in import described
from plans import node_plan, process_plan
from r2bspec import api
from r2bspec.language.spec import ProcessSettings
from r2bspec.plan.plan import NodePlan, Plan, ProcessPlan
from r2bspec.tune.launch_file import LAUNCH_FILE, NODES_FILE, launch_files

SPEC = """\
r2bspec: 1
name: robot
environment: [API_TOKEN]
playback: {mode: live}
transport: udp
containers:
  perception:
    executable: component_container_mt
    threads: 4
    cpus: [0, 1]
    arguments: [--ros-args, --log-level, warn]
    scheduling:
      policy: fifo
      priority: 40
      memory_lock: true
      threads: [{name: dds.*, policy: rr, priority: 60}]
  python: {executable: python, executor: multi_threaded, threads: 2, nice: 5, env: {OMP: 4}}
graph:
  nodes:
    rectify:
      package: image_proc
      plugin: image_proc::RectifyNode
      container: perception
      intra_process: true
      extra_arguments: {other: "10"}
      parameters: {queue_size: 20, name: "10", list: [a, "b'\\n"]}
      remappings: {image: image, image_rect: rect}
      publishes: {image_rect: sensor_msgs/msg/Image}
    left: {python: my.Left, container: python, remappings: {out: x}, parameters: {"a": [1.5]}}
    right: {python: my.Right, container: python}
    talker:
      package: demo_nodes_cpp
      executable: talker
      arguments: [--fast, "it's"]
      parameters: {s: "x: y", token: a$(env API_TOKEN)}
      remappings: {chatter: c}
      lifecycle: active
      prefix: [perf, record, "two words"]
    tool: {command: [echo, "$HOME 'x'", $(env API_TOKEN)], memory_limit: 1 GiB}
    others:
      launch: {package: image_proc, file: launch/x.launch.py, arguments: {a: true}}
      remappings: {x: y}
      env: {A: b}
monitors: {output: {topic: rect, format: sensor_msgs/msg/Image}}
benchmark: {duration: 1 s}
"""


@pytest.fixture
def plan(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Plan:
    monkeypatch.setenv("API_TOKEN", "secret-12345")
    spec = tmp_path / "robot.r2b.yaml"
    spec.write_text(SPEC)
    return api.compile_plan(spec)


def test_every_process_of_the_graph_and_nothing_of_the_harness(plan: Plan, tmp_path: Path) -> None:
    text = launch_files(plan, tmp_path)[LAUNCH_FILE]
    container, host, talker, tool, others, states = described(text)
    assert container.kind == "ComposableNodeContainer"
    assert (container.name, container.namespace) == ("perception", "/r2b")
    assert container.executable == "component_container_mt"
    assert container.parameters == [{"thread_num": 4}]
    assert container.arguments == ["--ros-args", "--log-level", "warn"]
    assert container.prefix == "taskset -c 0,1 chrt --fifo 40"
    (rectify,) = container.composable_node_descriptions
    assert rectify.plugin == "image_proc::RectifyNode"
    assert rectify.remappings == [("image", "image"), ("image_rect", "rect")]
    assert rectify.extra_arguments[0]["use_intra_process_comms"] is True
    # Launch would read a text that looks like a number as one.
    name = rectify.parameters[0]["name"]
    assert (name.words, name.value_type) == (("10",), str)
    assert rectify.parameters[0]["list"].words == (["a", "b'\n"],)
    assert host.cmd[:3] == [sys.executable, "-P", NODES_FILE]
    wanted = json.loads(host.cmd[3])
    assert (wanted["executor"], wanted["threads"]) == ("multi_threaded", 2)
    assert [node["target"] for node in wanted["nodes"]] == ["my.Left", "my.Right"]
    assert wanted["nodes"][0]["parameters"] == {"a": [1.5]}
    assert host.prefix == "nice -n 5"
    assert host.additional_env == {"OMP": "4"}
    assert (talker.kind, talker.name, talker.executable) == ("Node", "talker", "talker")
    assert talker.arguments == ["--fast", "it's"]
    assert talker.prefix == "perf record 'two words'"
    secret = talker.parameters[0]["token"].words[0]
    assert (secret[0], secret[1].words) == ("a", ("API_TOKEN",))
    assert tool.cmd[:2] == ["echo", "$HOME 'x'"]
    assert tool.cwd == str(tmp_path)
    assert [each.kind for each in others.words[0]] == [
        *("PushRosNamespace", "SetRemap", "SetEnvironmentVariable", "IncludeLaunchDescription"),
    ]
    assert others.words[0][-1].launch_arguments == [("a", "true")]
    assert json.loads(states.cmd[3]) == {"states": {"/r2b/talker": "active"}}
    assert "secret-12345" not in text


def test_what_a_launch_file_cannot_say_is_in_comments(plan: Plan, tmp_path: Path) -> None:
    text = launch_files(plan, tmp_path)[LAUNCH_FILE]
    said = " ".join(line.strip(" #") for line in text.splitlines() if line.strip()[:1] == "#")
    for part in (
        "mlockall",
        "threads dds.*: policy rr, priority 60",
        "rtprio",
        "more than 1073741824 B",
        "'transport: udp'",
    ):
        assert part in said
    assert all(len(line) < 100 for line in text.splitlines() if "FOLDER = " not in line)


HOSTILE = '\'"""\n\\ {x} %s\r\u2028\x00\u202e#'


def test_no_setting_of_a_process_is_lost() -> None:
    """A new one belongs into `_scheduling_words`, the program of Python nodes, or `_not_here`."""
    launched = {"cpus", "nice", "scheduling", "executor", "threads"}
    assert set(ProcessSettings.__struct_fields__) == launched


def test_everything_from_a_plan_is_data(plan: Plan, tmp_path: Path) -> None:
    node: NodePlan = node_plan(
        HOSTILE, target=HOSTILE, parameters={HOSTILE: HOSTILE}, remappings={HOSTILE: HOSTILE}
    )
    processes: tuple[ProcessPlan, ...] = (
        process_plan(HOSTILE, "host", nodes=(node,), env={"A": HOSTILE}, memory_limit_bytes=3),
        process_plan(HOSTILE, nodes=(node,), argv=(HOSTILE, "$(executable p e)")),
    )
    hostile = msgspec.structs.replace(plan, name=HOSTILE, processes=processes)
    text = launch_files(hostile, tmp_path / "a'\"b\n", [HOSTILE])[LAUNCH_FILE]
    host, command, _ = described(text)
    assert json.loads(host.cmd[3])["nodes"][0]["parameters"] == {HOSTILE: HOSTILE}
    assert host.additional_env == {"A": HOSTILE}
    assert command.cmd[0] == HOSTILE
    # Nothing but imports, two constants and the function.
    body = ast.parse(text).body
    allowed = (ast.Expr, ast.Import, ast.ImportFrom, ast.Assign, ast.FunctionDef)
    assert all(isinstance(statement, allowed) for statement in body)
    assert sum(isinstance(statement, ast.Expr) for statement in body) == 1
    assert len(text.splitlines()) == text.count("\n")


def test_without_python_nodes_no_second_file(plan: Plan, tmp_path: Path) -> None:
    talker = next(process for process in plan.processes if process.name == "talker")
    alone = msgspec.structs.replace(plan, processes=(talker,), lifecycle=msgspec.UNSET)
    files = launch_files(alone, tmp_path)
    assert files.keys() == {LAUNCH_FILE}
    assert "PYTHON_NODES" not in files[LAUNCH_FILE]


def test_the_program_of_python_nodes_needs_nothing_of_r2bspec(plan: Plan, tmp_path: Path) -> None:
    tree = ast.parse(launch_files(plan, tmp_path)[NODES_FILE])
    imported = {
        name.name if isinstance(node, ast.Import) else node.module or ""
        for node in ast.walk(tree)
        if isinstance(node, ast.Import | ast.ImportFrom)
        for name in node.names
    }
    assert not any(name.startswith("r2bspec") for name in imported)


NODES = """
from rclpy.node import Node
from rclpy.parameter import Parameter

class Said(Node):
    def __init__(self, **rest):
        super().__init__("unnamed", **rest)
        self.declare_parameter("note", "")
        print(self.get_fully_qualified_name(), self.get_parameter("note").value, flush=True)
        self.create_timer(0.01, self.end)

    def end(self):
        raise KeyboardInterrupt

def main():
    import rclpy
    rclpy.init()
    class Alone(Said):
        def __init__(self):
            super().__init__()
    rclpy.spin(Alone())
"""


@pytest.mark.parametrize("target", ["./own.py:Said", "./own.py:main"])
def test_python_nodes_run_with_rclpy_alone(plan: Plan, tmp_path: Path, target: str) -> None:
    pytest.importorskip("rclpy")
    program = tmp_path / NODES_FILE
    program.write_text(launch_files(plan, tmp_path)[NODES_FILE])
    (tmp_path / "own.py").write_text(NODES)
    node = {
        "target": target,
        "name": "left",
        "namespace": "/cell",
        "remappings": {},
        "parameters": {"note": "it's 10"},
    }
    wanted = {"executor": "single_threaded", "threads": 0, "nodes": [node]}
    done = subprocess.run(
        [sys.executable, "-P", str(program), json.dumps(wanted)],
        capture_output=True,
        text=True,
        cwd=tmp_path,
        check=False,
    )
    assert (done.returncode, done.stdout) == (0, "/cell/left it's 10\n"), done.stderr
