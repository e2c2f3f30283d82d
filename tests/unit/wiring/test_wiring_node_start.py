"""How a node is started is read from its constructor, and never guessed."""

from __future__ import annotations

import ast
from pathlib import Path
from typing import Any

import pytest
import yaml

from example_spec import example
from r2bspec.check import check
from r2bspec.diagnostics import Diagnostic
from r2bspec.language.load_spec import load_spec
from r2bspec.plan.compile_plan import compile_plan
from r2bspec.plan.plan import Plan
from r2bspec.plan.wiring.companion_files import read_companion_files
from r2bspec.plan.wiring.source_interface import read_start_style

NODES_FILE = Path(__file__).with_name("nodes.yaml")
STARTS = yaml.safe_load(NODES_FILE.read_text(encoding="utf-8"))["starts"]


@pytest.mark.parametrize("case", STARTS, ids=lambda case: case["text"])
def test_what_a_constructor_takes_decides(case: dict[str, Any]) -> None:
    assert read_start_style(ast.parse(case["text"]), "N") == case["start"]


NODES = """
import rclpy
from rclpy.node import Node
from sensor_msgs.msg import Image


class Plain(Node):
    def __init__(self):
        super().__init__("plain")
        self.out = self.create_publisher(Image, "output", 10)
        self.create_subscription(Image, "image", self.out.publish, 10)


class Flexible(Node):
    def __init__(self, **kwargs):
        super().__init__("flexible", **kwargs)
        self.out = self.create_publisher(Image, "output", 10)
        self.create_subscription(Image, "image", self.out.publish, 10)


class Demanding(Plain):
    def __init__(self, camera, **kwargs):
        super().__init__(**kwargs)


def main():
    rclpy.init()
    rclpy.spin(Plain())
"""
TOPICS = "subscribes: {image: sensor_msgs/msg/Image}, publishes: {output: sensor_msgs/msg/Image}"
"""What a spec has to state of a program."""


def spec(folder: Path, name: str, placement: str = "separate", container: str = "") -> Path:
    """A spec of two nodes, of which the first is called by this name."""
    (folder / "nodes.py").write_text(NODES, encoding="utf-8")
    keys = f", container: {container}" if container else ""
    sections = {"containers": f"{container}: {{executable: python}}"} if container else {}
    nodes = f"""
        placement: {placement}
        nodes:
          one: {{python: "./nodes.py:{name}"{keys}{f", {TOPICS}" if name == "main" else ""}}}
          two: {{python: "./nodes.py:Flexible", remappings: {{image: output, output: last}}{keys}}}
    """
    file = folder / "spec.r2b.yaml"
    monitors = "out: {topic: last, format: sensor_msgs/msg/Image}"
    text = example(graph=nodes, monitors=monitors, **sections)
    file.write_text(text, encoding="utf-8")
    return file


def findings(file: Path) -> list[Diagnostic]:
    return check(load_spec(file), offline=True)


def plan(file: Path) -> Plan:
    loaded = load_spec(file).spec
    assert loaded is not None
    return compile_plan(loaded, None, companion_files=read_companion_files(loaded, file.parent))


@pytest.mark.parametrize("placement", ["separate", "shared", "harness"])
@pytest.mark.parametrize("name", ["Plain", "main"])
def test_such_a_node_has_a_process_of_its_own(tmp_path: Path, name: str, placement: str) -> None:
    [process] = [
        listed
        for listed in plan(spec(tmp_path, name, placement)).processes
        if "one" in {node.node for node in listed.nodes}
    ]
    assert (process.name, process.role) == ("one", "host")
    assert len(process.nodes) == 1
