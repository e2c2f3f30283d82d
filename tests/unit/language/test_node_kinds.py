"""The kinds of node are listed once, and the rest of the program asks for their traits."""

from __future__ import annotations

import ast
import json
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import get_args

import pytest

from r2bspec.language.node_kinds import (
    NODE_KIND_KEYS,
    NODE_KINDS,
    NodeKindName,
    kinds_help,
    kinds_text,
)
from r2bspec.language.spec import Node
from r2bspec.plan import command_lines

PACKAGE = Path(__file__).parents[3] / "r2bspec"
MODULES = sorted(each for each in PACKAGE.rglob("*.py") if each.name != "node_kinds.py")
NAMES = set(get_args(NodeKindName))


def kinds_compared(source: str) -> Iterator[int]:
    """The lines on which the kind of a node is compared with the name of one."""
    for node in ast.walk(ast.parse(source)):
        if not isinstance(node, ast.Compare):
            continue
        sides = [node.left, *node.comparators]
        words = [
            each.value
            for side in sides
            for each in ast.walk(side)
            if isinstance(each, ast.Constant) and isinstance(each.value, str)
        ]
        if any("kind" in ast.dump(side).lower() for side in sides) and NAMES.intersection(words):
            yield node.lineno


@pytest.mark.parametrize("module", MODULES, ids=lambda path: str(path.relative_to(PACKAGE)))
def test_no_module_asks_for_a_kind_by_its_name(module: Path) -> None:
    assert list(kinds_compared(module.read_text())) == []


@pytest.mark.parametrize(
    "source",
    [
        'if node.kind == "python": pass',
        'if node.node.kind in {"python", "plugin"}: pass',
        'placed = [each for each in nodes if "launch" != each.kind.name]',
    ],
)
def test_a_comparison_would_be_found(source: str) -> None:
    assert list(kinds_compared(source))


def test_the_table_is_complete() -> None:
    assert [each.name for each in NODE_KINDS] == list(get_args(NodeKindName))
    assert set(NODE_KIND_KEYS) <= set(Node.__struct_fields__)
    assert set(command_lines._ARGV) == {each.name for each in NODE_KINDS if each.role is not None}
    suggested = [each.suggested for each in NODE_KINDS if each.snippet]
    assert sorted(suggested) == list(range(1, len(suggested) + 1))


def test_the_kinds_in_words() -> None:
    assert kinds_text() == (
        "'python', 'package' with 'plugin', 'package' with 'executable', 'command', 'launch', or "
        "'external'"
    )
    assert kinds_help() == (
        "'python', 'package' with 'plugin' or 'executable', 'command', 'launch', or "
        "'external: true'"
    )


ENTRY = """\
BUNDLE: Final = NodeKind(
    name="bundle",
    keys={"bundle": text("A program in one file.", examples=["./a.bundle"])},
    refuses=_NO_CONTAINER,
)

NODE_KINDS: Final = (BUNDLE, """

COMMAND_LINE = """\
    "launch": _launch,
    "bundle": lambda wired: (wired.node.bundle, *_ros_arguments(wired, wired.parameters)),
"""

EDITS = {
    "language/node_kinds.py": [
        ('"launch", "external"]', '"launch", "external", "bundle"]'),
        ("NODE_KINDS: Final = (", ENTRY),
    ],
    "language/spec.py": [
        ("    external: bool = False\n", '    external: bool = False\n    bundle: str = ""\n')
    ],
    "plan/command_lines.py": [('    "launch": _launch,\n', COMMAND_LINE)],
}
"""A kind of node that r2bspec does not have, in the three files of the recipe."""

SPEC = """\
r2bspec: 1
name: bundled
data_loader:
  bag: r2b_storage
  topics: {/d455_1_rgb_image: image}
playback:
  inputs:
    image: {from: image, format: sensor_msgs/msg/Image}
graph:
  nodes:
    detector:
      bundle: ./detector.bundle
      parameters: {threshold: 2}
      subscribes: {image: sensor_msgs/msg/Image}
      publishes: {out: sensor_msgs/msg/Image}
monitors:
  out: {topic: out, format: sensor_msgs/msg/Image}
benchmark: {rates: [30 Hz]}
"""


def test_three_files_are_all_that_a_kind_takes(tmp_path: Path) -> None:
    shutil.copytree(PACKAGE, tmp_path / "r2bspec", ignore=shutil.ignore_patterns("__pycache__"))
    spec = tmp_path / "bundled.r2b.yaml"
    spec.write_text(SPEC)

    def run(*arguments: str) -> subprocess.CompletedProcess[str]:
        command = [sys.executable, "-m", "r2bspec", *arguments]
        return subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)

    assert "R2B101" in run("validate", str(spec)).stdout
    for name, replacements in EDITS.items():
        file = tmp_path / "r2bspec" / name
        source = file.read_text()
        for old, new in replacements:
            assert source.count(old) == 1, old
            source = source.replace(old, new)
        file.write_text(source)
    checked = run("validate", str(spec))
    assert (checked.returncode, "no problems" in checked.stdout) == (0, True), checked.stdout
    plan = json.loads(run("plan", str(spec)).stdout)
    (process,) = [each for each in plan["processes"] if each["name"] == "detector"]
    assert process["role"] == "command"
    assert process["argv"][:2] == ["./detector.bundle", "--ros-args"]
    assert process["argv"][-2:] == ["-p", "threshold:=2"]
    spec.write_text(SPEC.replace("bundle: ./", "container: main\n      bundle: ./"))
    assert "only Python nodes and plugins run in a container" in run("validate", str(spec)).stdout
    assert "'bundle', 'python'" in run("schema", "spec").stdout
