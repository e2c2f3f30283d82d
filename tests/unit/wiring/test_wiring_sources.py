"""Where knowledge of a node's interface comes from: files, catalogue, source; best first."""

from __future__ import annotations

import textwrap
from pathlib import Path
from typing import Any

import pytest
import yaml
from wiring_specs import IMAGE, INFO, spec

from r2bspec.language.spec import Node, ParameterSource
from r2bspec.plan.wiring.build_wiring import build_wiring
from r2bspec.plan.wiring.companion_files import (
    NO_COMPANION_FILES,
    interface_file,
    read_companion_files,
)
from r2bspec.plan.wiring.node_interface import InterfaceEntry, catalogue_nodes, catalogue_packages
from r2bspec.plan.wiring.parameter_files import merged_parameters, read_parameter_file
from r2bspec.plan.wiring.python_files import read_python_file
from r2bspec.plan.wiring.source_interface import read_node_class
from r2bspec.plan.wiring.wiring import NodeWiring

NODES = yaml.safe_load(Path(__file__).with_name("nodes.yaml").read_text(encoding="utf-8"))


def read_node_source(file: Path, name: str) -> InterfaceEntry | None:
    """The interface of the class of a file."""
    tree = read_python_file(file)
    return None if tree is None else read_node_class(tree, name)


def wired(node: dict[str, Any], base_dir: Path | None = None) -> NodeWiring:
    document = spec({"n": node})
    files = NO_COMPANION_FILES if base_dir is None else read_companion_files(document, base_dir)
    return build_wiring(document, companion_files=files).measure.nodes[0]


# The catalogue


SOURCES = {"image_publisher::ImagePublisher"}
"""Nodes that read files or devices, and subscribe to nothing."""


def test_every_entry_of_the_catalogue_is_well_formed() -> None:
    for package in catalogue_packages():
        for name, entry in catalogue_nodes(package).items():
            assert entry.subscribes or name in SOURCES, name
            assert entry.publishes, name
            assert entry.parameters, name
            assert entry.executable, name
            assert entry.described_package == f"{package} of ROS 2 Jazzy"


@pytest.mark.parametrize(
    ("remappings", "topics"),
    [
        ({}, {"image": "/r2b/image", "camera_info": "/r2b/camera_info"}),
        (
            {"image": "left/image_raw"},
            {"image": "/r2b/left/image_raw", "/r2b/left/camera_info": "/r2b/left/camera_info"},
        ),
        (
            {"image": "left/image_raw", "left/camera_info": "info"},
            {"image": "/r2b/left/image_raw", "/r2b/left/camera_info": "/r2b/info"},
        ),
    ],
)
def test_camera_info_is_looked_for_in_the_namespace_of_the_remapped_image(
    remappings: dict[str, str], topics: dict[str, str]
) -> None:
    rectify = {"package": "image_proc", "plugin": "image_proc::RectifyNode"}
    measure = build_wiring(spec({"rectify": {**rectify, "remappings": remappings}})).measure
    ends = measure.endpoints_of("/r2b/rectify")
    assert {end.own_name: end.topic for end in ends if not end.is_publisher} == topics


# Source, read literally


def literal(tmp_path: Path, body: str, base: str = "Node", after: str = "") -> Any:
    file = tmp_path / "nodes.py"
    lines = "\n".join(f"        {line}" for line in body.splitlines())
    file.write_text(
        "from rclpy.node import Node\n"
        "import sensor_msgs.msg as m\n"
        "from std_msgs.msg import String as Text\n"
        f"class N({base}):\n    def __init__(self, **kwargs):\n"
        f"        super().__init__('n', **kwargs)\n{lines}\n{after}",
        encoding="utf-8",
    )
    return read_node_source(file, "N")


@pytest.mark.parametrize("case", NODES["classes"], ids=lambda case: case["body"])
def test_what_the_text_of_a_class_says(case: dict[str, Any], tmp_path: Path) -> None:
    after = textwrap.indent(case.get("after", ""), "    ")
    found = literal(tmp_path, case["body"], case.get("base", "Node"), after)
    parameters = found.parameters
    known = {
        "publishes": found.publishes,
        "subscribes": found.subscribes,
        "depths": {topic: qos.depth for topic, qos in found.qos.items()},
        "parameters": parameters and {name: each.type for name, each in parameters.items()},
    }
    expected = {key: value for key, value in case.items() if key in known}
    assert {key: known[key] for key in expected} == expected
    if "publishes" in case:
        why = case.get("why", "")
        assert why in found.may_publish_more
        assert bool(why) == bool(found.may_publish_more)


@pytest.mark.parametrize(
    "value",
    [
        "self.declare_parameter('topic', 'out').value",
        "self.declare_parameter('topic', 'out').get_parameter_value().string_value",
    ],
)
def test_a_parameter_names_a_topic(value: str, tmp_path: Path) -> None:
    (tmp_path / "nodes.py").write_text(
        "from rclpy.node import Node\nfrom sensor_msgs.msg import Image\n"
        "class N(Node):\n    def __init__(self):\n        super().__init__('n')\n"
        f"        name = {value}\n        self.create_publisher(Image, name, 1)\n",
        encoding="utf-8",
    )
    for parameters, topic in (({}, "out"), ({"topic": "other"}, "other")):
        node = wired({"python": "./nodes.py:N", "parameters": parameters}, tmp_path)
        assert node.interface.publishes == {topic: IMAGE}
        assert node.interface.publishes_all


@pytest.mark.parametrize(
    ("main", "known"),
    [
        ("rclpy.init()\nrclpy.spin(N())", True),
        ("rclpy.init()\nnode = N()\nrclpy.spin(node)", True),
        ("return N()", True),
        ("rclpy.init()\nrclpy.spin(rclpy.create_node('n'))", False),
    ],
)
def test_a_function_has_the_interface_of_the_class_of_which_it_makes_its_node(
    main: str, known: bool, tmp_path: Path
) -> None:
    file = tmp_path / "nodes.py"
    file.write_text(
        "import rclpy\nfrom rclpy.node import Node\nfrom sensor_msgs.msg import Image\n"
        "class N(Node):\n    def __init__(self):\n        super().__init__('n')\n"
        "        self.pub = self.create_publisher(Image, 'out', 5)\n"
        f"def main(args=None):\n{textwrap.indent(main, '    ')}\n",
        encoding="utf-8",
    )
    found = read_node_source(file, "main")
    assert found is not None
    assert found.publishes == ({"out": IMAGE} if known else None)
    assert bool(found.may_publish_more) is not known


@pytest.mark.parametrize(
    ("imports", "kind"),
    [
        (["sensor_msgs.msg import *"], IMAGE),
        (["sensor_msgs.msg import *", "numpy import *"], ""),
        (["numpy import *"], ""),
        (["own_msgs.msg import *", "sensor_msgs.msg import Image"], IMAGE),
        (["sensor_msgs.msg import Image", "own_msgs.msg import *"], ""),
        (["own_msgs.msg import Image", "sensor_msgs.msg import *"], ""),
    ],
)
def test_a_type_may_come_from_a_star_import(imports: list[str], kind: str, tmp_path: Path) -> None:
    file = tmp_path / "nodes.py"
    lines = "".join(f"from {line}\n" for line in ["rclpy.node import Node", *imports])
    body = (
        "class N(Node):\n    def __init__(self):\n        self.create_publisher(Image, 'out', 1)\n"
    )
    file.write_text(lines + body, encoding="utf-8")
    found = read_node_source(file, "N")
    assert found is not None
    assert (found.publishes, found.may_publish_more) == ({"out": kind}, "")


def test_files_of_which_nothing_can_be_said(tmp_path: Path) -> None:
    file = tmp_path / "nodes.py"
    assert read_node_source(file, "N") is None
    file.write_text("class N(:", encoding="utf-8")
    assert read_node_source(file, "N") is None
    file.write_text("def N(**kwargs): ...", encoding="utf-8")
    found = read_node_source(file, "N")
    assert found is not None
    assert found.publishes is None
    assert found.may_publish_more == "N makes no nodes of classes it names"


# Parameter files


def test_files_and_values_apply_in_order(tmp_path: Path) -> None:
    (tmp_path / "a.yaml").write_text(
        "/**:\n  ros__parameters: {gain: 1.0, camera: {width: 640}}\n"
        "r2b:\n  relay:\n    ros__parameters: {gain: 2.0}\n"
        "other:\n  ros__parameters: {gain: 9.0}\n",
        encoding="utf-8",
    )
    files = {"a.yaml": read_parameter_file(tmp_path / "a.yaml")}
    source, own = ParameterSource(file="a.yaml"), ParameterSource(values={"gain": 3.0})

    def merged(*sources: ParameterSource) -> dict[str, Any]:
        return merged_parameters(Node(parameter_sources=sources), "/r2b/relay", files)

    assert merged(source) == {"gain": 2.0, "camera.width": 640}
    assert merged(source, own)["gain"] == 3.0
    assert merged(own, source)["gain"] == 2.0


ALIASES = "a0: &a0 {}\n" + "".join(
    f"a{i}: &a{i} {{p: [*a{i - 1}, *a{i - 1}]}}\n" for i in range(1, 45)
)


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("[1, 2]", "is not a map of nodes"),
        ("a: 1\nb: {ros__parameters: {}}", "has no 'ros__parameters' below 'a'"),
        ("a: {ros__parameters: 1}", "has a 'ros__parameters' of 'a' that is not a map"),
        ("a: [", "is not YAML in line 2"),
        (
            "a: {ros__parameters: {x: !!python/object:os.system {}}}",
            "is not YAML in line 1",
        ),
        (
            "{a: " * 100_000,
            "cannot be used: line 1: values are nested more than 50 levels deep",
        ),
        (ALIASES, "cannot be used: line 12: aliases expand to more than 10,000 values"),
    ],
)
def test_files_that_ros_could_not_read(text: str, problem: str, tmp_path: Path) -> None:
    file = tmp_path / "p.yaml"
    file.write_text(text, encoding="utf-8")
    assert read_parameter_file(file).problem == problem


# Recorded interfaces


def test_a_recorded_interface_is_better_than_the_catalogue_but_not_than_the_spec(
    tmp_path: Path,
) -> None:
    file = interface_file(tmp_path, "n")
    file.parent.mkdir()
    file.write_text(
        f"subscribes: {{frame: {IMAGE}}}\npublishes: {{out: {IMAGE}}}\n"
        "services: {reset: std_srvs/srv/Trigger}\n"
        "qos: {out: {reliability: best_effort}}\nparameters: {gain: {type: double}}\n",
        encoding="utf-8",
    )
    component = {"package": "image_proc", "plugin": "image_proc::RectifyNode"}
    found = wired(component, tmp_path).interface
    assert (found.subscribes, found.subscribes_from) == ({"frame": IMAGE}, "file")
    assert found.qos["out"].reliability == "best_effort"
    assert found.other_remappable_names[0] == "reset"
    stated = wired({**component, "subscribes": {"x": INFO}}, tmp_path).interface
    assert (stated.subscribes_from, stated.publishes_from) == ("spec", "file")
    assert wired(component).interface.subscribes_from == "catalogue"


def test_an_interface_file_that_cannot_be_used_is_said_to_be_so(tmp_path: Path) -> None:
    file = interface_file(tmp_path, "n")
    file.parent.mkdir()
    for text in ("x: [", "[1]", "parameters: {a: 1}", "qos: {a: {depth: x}}", "x: 1"):
        file.write_text(text, encoding="utf-8")
        found = read_companion_files(spec({"n": {"command": ["x"]}}), tmp_path)
        assert found.interface_errors["n"]
        assert not found.interfaces


def test_source_outside_of_the_folder_is_not_read(tmp_path: Path) -> None:
    literal(tmp_path, "self.create_publisher(m.Image, 'out', 5)")
    inside = tmp_path / "inside"
    inside.mkdir()
    assert wired({"python": "../nodes.py:N"}, inside).interface.publishes is None
    assert wired({"python": "./nodes.py:N"}, tmp_path).interface.publishes == {"out": IMAGE}
