"""What of a Python script is evaluated, and what is not: nothing is ever executed."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
import yaml

from r2bspec.interop.script_import.benchmark_script import read_benchmark_script
from r2bspec.interop.script_import.evaluator import Evaluator
from r2bspec.interop.script_import.source_files import ScriptReader, UnusableScriptError
from r2bspec.interop.script_import.spec_builder import build_spec
from r2bspec.interop.script_import.values import Construct, ScriptLimitError, Unknown

SCRIPTS = yaml.safe_load(Path(__file__).with_name("scripts.yaml").read_text(encoding="utf-8"))


def names(folder: Path, code: str) -> dict[str, Any]:
    file = folder / "script.py"
    file.write_text(code)
    reader = ScriptReader(file)
    module = reader.read(file)
    Evaluator(reader).run_module(module)
    return module.scope.names


@pytest.mark.parametrize(
    ("code", "expected"), [(row["code"], row["x"]) for row in SCRIPTS["known"]]
)
def test_known(tmp_path: Path, code: str, expected: object) -> None:
    assert names(tmp_path, code)["x"] == expected


@pytest.mark.parametrize(
    ("code", "reason"), [(row["code"], row["reason"]) for row in SCRIPTS["unknown"]]
)
def test_unknown(tmp_path: Path, code: str, reason: str) -> None:
    found = names(tmp_path, code)["x"]
    assert isinstance(found, Unknown)
    assert found.reason == reason


def test_nothing_is_executed(tmp_path: Path) -> None:
    mark = tmp_path / "executed"
    found = names(
        tmp_path,
        f"import os, subprocess\nos.system('touch {mark}')\n"
        f"subprocess.run(['touch', '{mark}'])\nx = eval('1')\n"
        f"y = ().__class__.__base__.__subclasses__()\n__import__('os').mkdir('{mark}')\n",
    )
    assert not mark.exists()
    assert isinstance(found["x"], Unknown)
    assert isinstance(found["y"], Unknown)


@pytest.mark.parametrize("code", SCRIPTS["without an end"])
def test_limits(tmp_path: Path, code: str) -> None:
    with pytest.raises(ScriptLimitError):
        names(tmp_path, code)


def test_deep_expressions(tmp_path: Path) -> None:
    with pytest.raises((ScriptLimitError, UnusableScriptError)):
        names(tmp_path, "x = " + "-" * 5000 + "1")
    with pytest.raises((ScriptLimitError, UnusableScriptError)):
        names(tmp_path, "x = " + "+".join(["1"] * 20_000))


def test_modules_next_to_the_script(tmp_path: Path) -> None:
    package = tmp_path / "cell" / "cell"
    package.mkdir(parents=True)
    (package / "__init__.py").write_text("from .sizes import WIDTH\n")
    (package / "sizes.py").write_text("WIDTH = 7\nfrom cell import WIDTH as AGAIN\n")
    scripts = tmp_path / "cell" / "scripts"
    scripts.mkdir()
    found = names(scripts, "from cell import WIDTH\nimport cell.sizes as s\nx = WIDTH + s.WIDTH")
    assert found["x"] == 14


def test_calls_of_others_are_constructs(tmp_path: Path) -> None:
    found = names(tmp_path, "from a.b import C\nx = C(1, k='v').run(2)")["x"]
    assert isinstance(found, Construct)
    assert (found.name, found.arguments) == ("a.b.C.run", [2])
    assert found.owner is not None
    assert found.owner.keywords == {"k": "v"}


@pytest.mark.parametrize(
    ("code", "expected"), [(row["code"], row["finding"]) for row in SCRIPTS["unusable"]]
)
def test_unusable_scripts(tmp_path: Path, code: str, expected: str) -> None:
    file = tmp_path / "script.py"
    file.write_text(code)
    with pytest.raises(UnusableScriptError) as error:
        read_benchmark_script(file)
    assert error.value.finding.code == expected
    assert error.value.finding.help
    assert error.value.finding.span.file == str(file)


def test_nodes_of_a_missing_module_are_left_out(tmp_path: Path) -> None:
    """What a function of another package makes is not known, and no node without a kind is left."""
    script = tmp_path / "far.py"
    script.write_text(
        "from cell_far import make_node, make_monitor\n"
        "from launch_ros.actions import ComposableNodeContainer\n"
        "from launch_ros.descriptions import ComposableNode\n"
        "from ros2_benchmark import ROS2BenchmarkConfig, ROS2BenchmarkTest\n\n"
        "def launch_setup(prefix, timeout):\n"
        "    own = ComposableNode(name='own', package='cell', plugin='cell::Own')\n"
        "    return [ComposableNodeContainer(\n"
        "        name='all', package='rclcpp_components', executable='component_container',\n"
        "        composable_node_descriptions=[own, make_node('far'), make_monitor(1)])]\n\n"
        "def generate_test_description():\n"
        "    return FarTest.generate_test_description_with_nsys(launch_setup)\n\n"
        "class FarTest(ROS2BenchmarkTest):\n"
        "    config = ROS2BenchmarkConfig(benchmark_name='Far', benchmark_mode='LIVE')\n"
    )
    read = read_benchmark_script(script)
    spec = build_spec(read, tmp_path)
    said = [finding.message for finding in spec.findings if finding.code == "R2B710"]
    assert any("the node that make_node makes is not known" in each for each in said)
    assert any("make_monitor" in each for each in said)
    (missing,) = [finding for finding in spec.findings if finding.code == "R2B705"]
    assert missing.severity == "error"
    assert missing.span.line == 1
    assert "'cell_far'" in missing.message
    assert "make_node, make_monitor" in missing.message
    assert "--package-path" in missing.help
    assert [node.name for node in read.parts.nodes] == ["own"]
    assert "No monitor of the script is known" in spec.text
