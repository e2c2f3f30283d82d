"""A recorded interface is used for the node that it was recorded from, and for no other."""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import Any

import pytest
import yaml
from wiring_specs import IMAGE

from ament_packages import install_package
from example_spec import example
from r2bspec.check import check
from r2bspec.diagnostics import Diagnostic
from r2bspec.language.load_spec import load_spec

FLOAT = "std_msgs/msg/Float32"
# Nothing in it is literal: what is known of it is what was recorded.
NODE = """
from rclpy.node import Node
from sensor_msgs.msg import Image


def make(**kwargs):
    node = Node("any", **kwargs)
    for name in ("image",):
        node.create_subscription(Image, name, print, 10)
        node.create_publisher(Image, f"{name}_out", 10)
    return node
"""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "node.py").write_text(NODE, encoding="utf-8")
    (tmp_path / "interfaces").mkdir()
    return tmp_path


def record(folder: Path, target: str = "./node.py:make", **row: Any) -> None:
    digest = hashlib.sha256(hashlib.sha256((folder / "node.py").read_bytes()).digest())
    recorded = {"target": target, "sha256": digest.hexdigest()}
    content = {
        "recorded_from": recorded,
        "subscribes": {"image": IMAGE},
        "publishes": {"output": FLOAT},
        "parameters": {"gain": {"type": "double"}},
    }
    text = yaml.safe_dump(content | row)
    (folder / "interfaces" / "my_node.yaml").write_text(text, encoding="utf-8")


def findings(folder: Path, text: str = 'python: "./node.py:make"') -> dict[str, Diagnostic]:
    file = folder / "spec.r2b.yaml"
    file.write_text(example(graph=f"nodes: {{my_node: {{{text}}}}}"), encoding="utf-8")
    return {found.code: found for found in check(load_spec(file), offline=True)}


def test_a_finding_names_the_record_that_it_rests_on(folder: Path) -> None:
    record(folder)
    for keys, code in (
        ("", "R2B210"),
        (", parameters: {gian: 1.0}", "R2B211"),
        (", parameters: {gain: 1}", "R2B212"),
        (", remappings: {imgae: image}", "R2B204"),
    ):
        found = findings(folder, f'python: "./node.py:make"{keys}')[code]
        assert found.severity == "error"
        assert found.help.strip(")").endswith("recorded in interfaces/my_node.yaml")


def test_a_missing_publisher_names_the_records_that_lack_it(folder: Path) -> None:
    record(folder, publishes={"other": IMAGE})
    found = findings(folder)["R2B207"]
    assert found.severity == "error"
    assert found.help.endswith("(recorded in interfaces/my_node.yaml)")


def test_the_record_of_another_node_is_not_used_and_that_is_said(folder: Path) -> None:
    record(folder, "./brightness.py:Brightness")
    found = findings(folder)
    assert "R2B210" not in found
    assert found["R2B223"].message == (
        "'interfaces/my_node.yaml' is ignored: it was recorded from './brightness.py:Brightness', "
        "and the node is './node.py:make'"
    )


def test_a_stale_record_is_not_used_and_that_is_said(folder: Path) -> None:
    record(folder)
    assert "R2B223" not in findings(folder)
    (folder / "node.py").write_text(f"{NODE}# changed\n", encoding="utf-8")
    found = findings(folder)
    assert "R2B210" not in found
    assert "'./node.py:make' has changed since it was recorded" in found["R2B223"].message


def test_with_another_version_of_the_package_nothing_is_certain(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    manifest = {"package.xml": "<package><version>1.3.0</version></package>"}
    prefix = install_package(folder / "ros", "detectors", manifest)
    monkeypatch.setenv("AMENT_PREFIX_PATH", str(prefix))
    for version, severity in (("1.3.0", "error"), ("1.2.9", "warning")):
        record(folder, recorded_from={"target": "detectors D", "version": version})
        found = findings(folder, "package: detectors, plugin: D")
        assert found["R2B210"].severity == severity
