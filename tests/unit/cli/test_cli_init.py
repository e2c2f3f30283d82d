"""`r2bspec init`: from nothing to a valid spec, guided by messages."""

from __future__ import annotations

from pathlib import Path

import pytest

from command_line import Call
from r2bspec.api import compile_plan, validate
from r2bspec.cli.main import main
from r2bspec.diagnostics import Certainty
from r2bspec.language.templates import node_key, purpose, templates

ROOT = Path(__file__).parents[3]


@pytest.fixture(autouse=True)
def _empty_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


@pytest.mark.parametrize("template", templates())
def test_every_template_is_valid_and_has_a_plan(template: str) -> None:
    assert main(["init", "camera", "--template", template]) == 0
    file = Path("camera.r2b.yaml")
    assert {one.certainty for one in validate(file)} <= {Certainty.ENVIRONMENT}
    assert compile_plan(file).name == "camera"
    assert "my_node" not in file.read_text(encoding="utf-8"), "the node of the template"


def test_what_is_written(call: Call) -> None:
    said = call("init", "camera", status=0).out
    text = Path("camera.r2b.yaml").read_text()
    assert text.startswith("# Completion and checks in editors: 'r2bspec docs editors'\n")
    assert "\nname: camera\n" in text
    assert [file.name for file in Path().iterdir()] == ["camera.r2b.yaml"]
    assert "r2bspec validate camera.r2b.yaml" in said


def test_a_schema_beside_the_spec_is_named(call: Call) -> None:
    schema = Path("r2bspec-v1.schema.json")
    schema.write_text(call("docs", "--schema", "spec", status=0).out)
    call("init", "camera", status=0)
    first = "# yaml-language-server: $schema=./r2bspec-v1.schema.json\n"
    assert Path("camera.r2b.yaml").read_text().startswith(first)


@pytest.mark.parametrize(
    ("arguments", "file", "name"),
    [
        ((), "my_benchmark.r2b.yaml", "my_benchmark"),
        (("benchmarks/camera.r2b.yaml",), "benchmarks/camera.r2b.yaml", "camera"),
    ],
)
def test_the_name_may_be_left_out_or_have_a_folder_and_a_suffix(
    arguments: tuple[str, ...], file: str, name: str, call: Call
) -> None:
    Path("benchmarks").mkdir()
    call("init", *arguments, status=0)
    assert f"\nname: {name}\n" in Path(file).read_text()


def test_nothing_is_overwritten(call: Call) -> None:
    Path("camera.r2b.yaml").write_text("mine")
    error = call("init", "camera", status=2).err
    assert Path("camera.r2b.yaml").read_text() == "mine"
    assert "error[R2B601 wrong-usage]: camera.r2b.yaml already exists" in error


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["my bench"], "for example my_bench"),
        (["nowhere/camera"], "cannot be written"),
        (["camera", "--template", "minimul"], "did you mean 'minimal'?"),
        (["camera", "--template", "x"], "templates:"),
        (["camera", "--node", "brightness.py"], "a Python node has the form module.Class"),
        (
            ["camera", "--node", "a.B", "--template", "components"],
            "Use --node with one of these: live, ",
        ),
        (["camera", "--node", "./gone.py:Gone"], "gone.py does not exist"),
        (["camera", "--node", "./here.py:Gone"], "has no class or function 'Gone'"),
        (["camera", "--params-file", "here.py"], "--params-file needs --node"),
        (
            ["camera", "--node", "./here.py:Here", "--params-file", "gone.yaml"],
            "gone.yaml does not exist",
        ),
    ],
)
def test_wrong_usage_writes_nothing(arguments: list[str], said: str, call: Call) -> None:
    Path("here.py").write_text("class Here: ...\n", encoding="utf-8")
    assert said in call("init", *arguments, status=2).err
    assert [file.name for file in Path().iterdir()] == ["here.py"]


def test_a_path_of_the_command_line_is_relative_to_the_current_folder(call: Call) -> None:
    Path("here.py").write_text("class Here: ...\n", encoding="utf-8")
    Path("bench").mkdir()
    call("init", "bench/camera", "--node", "./here.py:Here", status=0)
    assert "../here.py:Here" in Path("bench/camera.r2b.yaml").read_text()
    assert "bench/here.py" not in call("init", "x", "--node", "gone.py:Gone", status=2).err


def test_the_list_says_what_each_is_for(call: Call) -> None:
    lines = call("init", "--list", status=0).out.splitlines()
    assert [line.split()[0] for line in lines] == list(templates())
    assert all(
        purpose(text) in line for text, line in zip(templates().values(), lines, strict=True)
    )
    assert max(map(len, lines)) <= 140


@pytest.mark.parametrize(
    ("target", "name", "key"),
    [
        ("r2bspec.nodes.RelayNode", "", "relay"),
        ("./nodes/aruco.py:HTTPCameraNode", "", "http_camera"),
        ("./brightness.py:main", "", "brightness"),
        ("my_package.brightness.main", "", "brightness"),
        ("./player.py:Player", "", "player_node"),
        ("a.Node", "", "node"),
        ("./eye.py:main", "Left_Eye", "Left_Eye"),
        ("./eye.py:main", "player", "eye"),
        ("./eye.py:main", "a b", "eye"),
    ],
)
def test_a_node_has_the_name_of_its_source_or_the_key_of_its_class(
    target: str, name: str, key: str
) -> None:
    assert node_key(target, name) == key


NODE = """
from rclpy.node import Node
from std_msgs.msg import String


class Talks(Node):
    def __init__(self, **kwargs):
        super().__init__("talks", **kwargs)
        self.out = self.create_publisher(String, "out", 10)
        self.create_subscription(String, "in", self.out.publish, 10)
"""


@pytest.mark.parametrize(
    ("words", "judged"),
    [(("--node", "./talks.py:Talks"), "judges nothing: add 'slos:'"), ((), "by its 'slos:'")],
)
def test_a_spec_without_objectives_is_not_said_to_judge(
    words: tuple[str, ...], judged: str, call: Call
) -> None:
    Path("talks.py").write_text(NODE)
    said = call("init", "talks", *words, status=0).out
    assert judged in said
    assert ("\nslos:" in Path("talks.r2b.yaml").read_text()) == (not words)
