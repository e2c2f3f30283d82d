"""What executing a script or a launch file records, and how it ends."""

from __future__ import annotations

import time
from pathlib import Path

import pytest

from r2bspec.interop.recording import RecordedFile, UnusableFileError, record
from r2bspec.interop.script_spec import import_script

SCRIPT = """
import json, os, subprocess, sys, time
from launch.substitutions import *
from launch_ros.actions import Node
from launch_ros.descriptions import ComposableNode
from ros2_benchmark import ImageResolution, ROS2BenchmarkConfig, ROS2BenchmarkTest

def launch_setup(prefix, timeout):
    {before}
    return [Node(name='eye', package='cell', executable='eye', parameters=[{{'x': {value}}}])]

def generate_test_description():
    {setup}
    return CellTest.generate_test_description_with_nsys(launch_setup)

class CellTest(ROS2BenchmarkTest):
    config = ROS2BenchmarkConfig(benchmark_name='Cell', benchmark_mode='LIVE')

    def pre_benchmark_hook(self):
        {hook}
"""


def script(folder: Path, **parts: str) -> Path:
    file = folder / "script.py"
    usual = {"before": "pass", "setup": "pass", "hook": "pass", "value": "1"}
    file.write_text(SCRIPT.format(**usual | parts))
    return file


def recorded(folder: Path, **parts: str) -> RecordedFile:
    return record(script(folder, **parts), "script")


@pytest.mark.parametrize(
    ("value", "expected"),
    [
        ("ImageResolution.HD['width'] // 2", 640),
        ("os.path.join(CellTest.get_assets_root_path(), 'a.onnx')", "$(assets)/a.onnx"),
        ("os.path.join(os.path.dirname(__file__), 'a.yaml')", "$(script)/a.yaml"),
        ("os.environ['CELL']", "$(env CELL)"),
        ("os.environ.get('CELL')", "$(env CELL)"),
        ("os.getenv('CELL', 'left')", "left"),
        ("EnvironmentVariable('CELL')", "$(env CELL)"),
        ("[1, 2.5]", [1.0, 2.5]),
        ("TextSubstitution(text='12')", 12),
    ],
)
def test_values(tmp_path: Path, value: str, expected: object) -> None:
    (node,) = recorded(tmp_path, value=value).nodes
    assert node.parameters == [{"x": expected}]


@pytest.mark.parametrize(
    ("value", "what"),
    [
        ("open('/nowhere/labels.txt').read().splitlines()", "the content of a file"),
        ("json.load(open('/nowhere/a.json'))['x']", "the content of a file"),
        ("subprocess.check_output(['make'])", "the result of subprocess.check_output()"),
        ("f'{Node.engine}.plan'", "the value of launch_ros.actions.Node.engine"),
        ("Command(['xacro ', 'a'])", "the result of launch.substitutions.Command()"),
    ],
)
def test_an_unknown_value_has_a_mark_and_its_line(tmp_path: Path, value: str, what: str) -> None:
    read = recorded(tmp_path, value=value)
    assert str(read.nodes[0].parameters[0]["x"]).startswith("$(unknown 0)")
    assert [(unknown.what, unknown.place[1]) for unknown in read.unknown] == [(what, 10)]


@pytest.mark.parametrize(
    ("before", "noted"),
    [
        ("if Node.fast: pass", "is not known; it is taken as true"),
        ("for name in Node.names: pass", "is not known; it is taken as empty"),
        ("os.remove('/tmp/x')", "what remove() does is left out"),
        ("open(__file__ + '.txt', 'w').write('x')", "what is written into a file is left out"),
        ("ComposableNode.upload()", "what upload() does is left out"),
    ],
)
def test_what_is_assumed_or_left_out_is_noted(tmp_path: Path, before: str, noted: str) -> None:
    read = recorded(tmp_path, before=before)
    assert any(noted in note.reason and note.place[1] == 9 for note in read.notes)
    assert [file.name for file in tmp_path.iterdir()] == ["script.py"]


def test_steps_are_recorded_and_not_done(tmp_path: Path) -> None:
    made = tmp_path.parent / f"{tmp_path.name}_made"
    setup = f"""
    if not os.path.isfile('{made}/a.plan'):
        os.makedirs('{made}')
        subprocess.run(['build', '--to', '{made}/a.plan'])
    os.system('touch {made}')"""
    hook = f"""
        while not os.path.exists('{made}/a.plan'):
            time.sleep(1)
        time.sleep(30)"""
    read = recorded(tmp_path, setup=setup, hook=hook)
    assert not made.exists()
    assert [(step.kind, step.command[:1], step.creates or step.file) for step in read.steps] == [
        ("setup", ["mkdir"], str(made)),
        ("setup", ["build"], f"{made}/a.plan"),
        ("setup", ["sh"], ""),
        ("ready", [], f"{made}/a.plan"),
    ]
    assert [note.reason[:26] for note in read.notes] == ["the script waits 30 s here"]


def test_a_file_without_which_the_script_gives_up_exists(tmp_path: Path) -> None:
    setup = "os.path.isfile('/nowhere/a.onnx') or sys.exit('no model')"
    assert [node.name for node in recorded(tmp_path, setup=setup).nodes] == ["eye"]


def test_the_environment_of_this_machine_stays_here(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("CELL_TOKEN", "secret")
    value = "str(dict(os.environ)) + str(os.environ.copy()) + str([*os.environ.items()])"
    (node,) = recorded(tmp_path, value=value).nodes
    assert "secret" not in str(node)


def test_it_is_said_before(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(UnusableFileError):
        recorded(tmp_path, before="raise OSError('late')")
    assert capsys.readouterr().err.startswith(f"executing {tmp_path}/script.py to read its")


@pytest.mark.parametrize(
    ("code", "place", "message"),
    [
        ("x = (1\n", 1, "invalid Python: '(' was never closed"),
        ("\nx = nothing\n", 2, "NameError: name 'nothing' is not defined"),
        ("import os\nos.kill(os.getpid(), 9)\n", 1, "it ends its process with status -9"),
        ("x = 1\n", 1, "no class of this file is a ROS2BenchmarkTest with a 'config'"),
        ("import sys\nsys.exit()\n", 2, "SystemExit: "),
    ],
)
def test_unusable_files(tmp_path: Path, code: str, place: int, message: str) -> None:
    file = tmp_path / "script.py"
    file.write_text(code)
    with pytest.raises(UnusableFileError) as error:
        record(file, "script")
    finding = error.value.finding
    assert (finding.message, finding.span.line, finding.span.file) == (message, place, str(file))


def test_a_file_that_does_not_end_leaves_no_process(tmp_path: Path) -> None:
    """Its process group ends, and with it the processes that it has started."""
    file, beats = tmp_path / "script.py", tmp_path / "beats"
    program = f"import time\nwhile open({str(beats)!r}, 'a').write('.'): time.sleep(0.05)"
    file.write_text(f"import os, sys\nos.fork() or exec({program!r}, {{}})\nwhile True: pass\n")
    with pytest.raises(UnusableFileError, match="it does not end within 3 s"):
        record(file, "script", time_limit_s=3)
    before = beats.stat().st_size
    time.sleep(0.5)
    assert beats.stat().st_size == before


def test_nodes_of_a_missing_module_are_left_out(tmp_path: Path) -> None:
    file = script(tmp_path, before="from cell_far import make_node")
    file.write_text(file.read_text().replace("return [Node", "return [make_node('far'), Node"))
    findings = import_script(file, tmp_path).findings
    (error,) = [finding for finding in findings if finding.severity == "error"]
    assert (error.code, error.span.line) == ("R2B705", 10)
    assert "cell_far.make_node" in error.message
    package = tmp_path / "elsewhere" / "cell_far"
    package.mkdir(parents=True)
    (package / "__init__.py").write_text(
        "from launch_ros.actions import Node\n"
        "def make_node(name):\n    return Node(name=name, package='far', executable='far')\n"
    )
    spec = import_script(file, tmp_path, [tmp_path / "elsewhere"])
    assert "executable: far" in spec.text
    assert all(finding.severity != "error" for finding in spec.findings)
