"""Where knowledge of a node's interface comes from: files, catalogue, source; best first."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from wiring_specs import IMAGE, INFO, node, spec

from r2bspec.language.spec import Node, ParameterSource
from r2bspec.plan.wiring.ast_reader import read_node_class
from r2bspec.plan.wiring.build_wiring import build_wiring
from r2bspec.plan.wiring.companion_files import (
    NO_COMPANION_FILES,
    interface_file,
    read_companion_files,
)
from r2bspec.plan.wiring.node_interface import (
    InterfaceEntry,
    catalogue_entry,
    catalogue_nodes,
    catalogue_packages,
)
from r2bspec.plan.wiring.parameter_files import merged_parameters, read_parameter_file
from r2bspec.plan.wiring.python_files import read_python_file
from r2bspec.plan.wiring.wiring import NodeWiring


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


def test_a_component_is_known_by_plugin_and_by_executable() -> None:
    plugin = catalogue_entry(node(package="image_proc", plugin="image_proc::RectifyNode"))
    assert plugin is catalogue_entry(node(package="image_proc", executable="rectify_node"))
    assert plugin is not None
    assert catalogue_entry(node(package="image_proc", plugin="image_proc::Other")) is None
    assert catalogue_entry(node(package="other", plugin="image_proc::RectifyNode")) is None


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


def test_literal_calls_are_understood(tmp_path: Path) -> None:
    found = literal(
        tmp_path,
        "self.pub = self.create_publisher(m.Image, 'out', 5)\n"
        "self.create_subscription(Text, topic='words', callback=print, qos_profile=1)\n"
        "self.declare_parameter('gain', 0.5)\n"
        "self.declare_parameter('name')",
    )
    assert found.publishes == {"out": IMAGE}
    assert found.subscribes == {"words": "std_msgs/msg/String"}
    assert found.qos["out"].depth == 5
    assert found.parameters["gain"].type == "double"
    assert found.parameters["name"].type == ""


@pytest.mark.parametrize(
    ("body", "publishes", "why"),
    [
        ("self.create_publisher(m.Image, NAME, 1)", {}, "line 7 makes a publisher whose topic"),
        (
            "if kwargs:\n    self.create_publisher(m.Image, 'out', 1)",
            {"out": IMAGE},
            "whether line 8 makes a publisher",
        ),
        (
            "for t in 'ab':\n    self.create_publisher(m.Image, t, 1)",
            {},
            "line 8 makes a publisher",
        ),
        ("self.create_publisher(kwargs['type'], 'out', 1)", {"out": ""}, ""),
        ("Helper(self)\nself.create_publisher(m.Image, 'out', 1)", {"out": IMAGE}, "Helper()"),
        (
            "make = self.create_publisher\nself.create_publisher(m.Image, 'out', 1)",
            {"out": IMAGE},
            "line 7 uses create_publisher other than by calling it",
        ),
        (
            "if kwargs:\n    self.create_publisher(m.Image, 'out', 1)\n"  # noqa: ISC004
            "self.create_publisher(Text, 'out', 1)",
            {"out": ""},
            "whether line 8",
        ),
    ],
)
def test_literal_topics_are_known_and_what_may_be_missing_has_a_reason(
    body: str, publishes: Any, why: str, tmp_path: Path
) -> None:
    found = literal(tmp_path, body)
    assert found.publishes == publishes
    assert why in found.may_publish_more
    assert bool(why) == bool(found.may_publish_more)


@pytest.mark.parametrize(
    ("body", "tick", "timed"),
    [
        ("self.create_timer(0.02, self.tick)", "self.pub.publish(1)", {"out": "0.02"}),
        (
            "period = 1 / 50\nself.create_timer(period, self.tick)",
            "self.pub.publish(1)",
            {"out": "1 / 50"},
        ),
        (
            "self.create_timer(1 / self.get_parameter('hz').value, self.tick)",
            "self.pub.publish(1)",
            {"out": "1 / $(parameter hz)"},
        ),
        ("self.create_timer(kwargs['p'], self.tick)", "self.pub.publish(1)", {"out": None}),
        ("self.create_timer(1, self.tick)", "if self.x: self.pub.publish(1)", {"out": "1"}),
        ("self.create_timer(1, self.tick)", "while self.x: self.pub.publish(self.x.pop())", {}),
        ("self.create_timer(1, self.tick)\nself.tick()", "self.pub.publish(1)", {}),
        ("self.create_timer(1, self.tick)\nself.pub.publish(1)", "self.pub.publish(1)", {}),
        ("self.create_timer(1, self.tick)", "print(1)", {}),
    ],
)
def test_what_a_timer_publishes_has_its_pace(
    body: str, tick: str, timed: Any, tmp_path: Path
) -> None:
    """Not in a loop, which may empty a queue of inputs, and not where inputs publish it, too."""
    made = "self.pub = self.create_publisher(m.Image, 'out', 1)\nself.x = []"
    found = literal(tmp_path, f"{made}\n{body}", after=f"    def tick(self):\n        {tick}\n")
    assert found.timed == timed


@pytest.mark.parametrize(
    "body",
    [
        "topic = 'out'\nself.create_publisher(m.Image, topic, 1)",
        "self.topic = 'out'\nself.create_publisher(m.Image, self.topic, 1)",
    ],
)
def test_a_topic_is_followed_to_its_only_text(body: str, tmp_path: Path) -> None:
    found = literal(tmp_path, body)
    assert (found.publishes, found.may_publish_more) == ({"out": IMAGE}, "")


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
    ("body", "declared"),
    [
        ("self.declare_parameters('', [('a', 1), ('b', 'x')])", {"a", "b"}),
        ("self.declare_parameters('', names)", None),
        ("for name in 'ab':\n    self.declare_parameter(name, 1)", None),
    ],
)
def test_parameters_are_known_together(body: str, declared: Any, tmp_path: Path) -> None:
    found = literal(tmp_path, body).parameters
    assert (None if found is None else set(found)) == declared


@pytest.mark.parametrize("base", ["Other", "Node, Other"])
def test_what_a_class_inherits_is_not_known(base: str, tmp_path: Path) -> None:
    found = literal(tmp_path, "self.create_publisher(m.Image, 'out', 1)", base)
    assert found.publishes == {"out": IMAGE}
    assert found.may_publish_more == f"N inherits from {base}, which may have others"


def test_a_class_with_methods_of_its_own_to_make_topics_is_unknown(tmp_path: Path) -> None:
    body = "self.create_publisher(m.Image, 'out', 1)\nN.create_publisher = print"
    found = literal(tmp_path, body)
    assert found.publishes is None
    assert "methods of its own" in found.may_publish_more


MAKES_OUT = "rclpy.init()\nnode = rclpy.create_node('n')\nnode.create_publisher(Image, 'out', 5)\n"


def program(tmp_path: Path, main: str) -> Any:
    """What is known of ``main`` with this body, in the file of a node in another folder."""
    file = tmp_path / "src/package/nodes.py"
    file.parent.mkdir(parents=True, exist_ok=True)
    lines = "\n".join(f"    {line}" for line in main.splitlines())
    file.write_text(
        "import rclpy\nimport helpers\nfrom helpers import add\n"
        "from rclpy.executors import MultiThreadedExecutor\nfrom rclpy.node import Node\n"
        "from sensor_msgs.msg import Image\n"
        "class N(Node):\n    def __init__(self):\n        super().__init__('n')\n"
        "        self.pub = self.create_publisher(Image, 'out', 5)\n"
        f"def main(args=None):\n{lines}\n",
        encoding="utf-8",
    )
    return read_node_source(file, "main")


@pytest.mark.parametrize(
    "main",
    [
        "rclpy.init()\nrclpy.spin(N())",
        (
            "rclpy.init(args=args)\nnode = N()\ntry:\n    rclpy.spin(node)\n"
            "except KeyboardInterrupt:\n    pass\nfinally:\n    node.destroy_node()\n"
            "    if rclpy.ok():\n        rclpy.shutdown()"
        ),
        (
            "with rclpy.init(args=args):\n    node = N()\n    executor = MultiThreadedExecutor()\n"
            "    executor.add_node(node)\n    node.get_logger().info('spins')\n    executor.spin()"
        ),
        f"{MAKES_OUT}rclpy.spin(node)",
        f"{MAKES_OUT.replace('rclpy.create_node', 'Node')}node.create_timer(1.0, lambda: None)",
        (
            "with rclpy.init(args=args):\n    node = rclpy.create_node('n')\n"
            "    publisher = node.create_publisher(Image, 'out', 5)\n"
            "    def on_timer():\n        publisher.publish(Image())\n"
            "        node.get_logger().info('published')\n"
            "    node.create_timer(1.0, on_timer)\n    executor = MultiThreadedExecutor()\n"
            "    executor.add_node(node)\n    try:\n        executor.spin()\n"
            "    finally:\n        node.destroy_node()"
        ),
    ],
)
def test_a_program_has_the_interface_of_the_node_that_it_makes(main: str, tmp_path: Path) -> None:
    found = program(tmp_path, main)
    assert (found.publishes, found.may_publish_more) == ({"out": IMAGE}, "")


@pytest.mark.parametrize(
    "main",
    [
        "rclpy.init()\nnode = N()\nnode.create_publisher(Image, 'more', 1)\nrclpy.spin(node)",
        "rclpy.init()\nnode = N()\nadd(node)\nrclpy.spin(node)",
        "rclpy.init()\nnode = N()\nhelpers.spin(node)",
        "rclpy.init()\nnode = N()\nnode = helpers\nnode.spin(N())",
        "rclpy.init()\nN()\nrclpy.spin(N())",
        "rclpy.init()\nfor name in 'ab':\n    rclpy.spin(N())",
        "rclpy.init()\nif args:\n    rclpy.spin(N())",
        "rclpy.init()\nrclpy.spin(N(args))",
        "rclpy.init()\nrclpy.spin(Node('other'))",
        f"{MAKES_OUT}add(node)",
        f"{MAKES_OUT}timer = helpers.Timer(lambda: add(node))",
        f"{MAKES_OUT}if args:\n    node.create_publisher(Image, 'out', 1)",
        f"{MAKES_OUT}for name in args:\n    node.create_publisher(Image, name, 1)",
        f"{MAKES_OUT}def more():\n    node.create_publisher(Image, 'out', 1)",
        f"{MAKES_OUT}def more(node):\n    node.create_publisher(Image, 'more', 1)",
        f"{MAKES_OUT}other = Node('other')\nother.create_publisher(Image, 'more', 1)",
        f"{MAKES_OUT}rclpy.spin(helpers.other)",
        f"{MAKES_OUT}node = helpers.other\nrclpy.spin(node)",
        f"{MAKES_OUT}def change():\n    nonlocal node\n    node = helpers.other",
        f"{MAKES_OUT}MultiThreadedExecutor().add_node(helpers.other)",
        f"rclpy.init()\nif args:\n    {MAKES_OUT.splitlines()[1]}",
    ],
)
def test_what_a_program_does_besides_is_a_reason_for_more(main: str, tmp_path: Path) -> None:
    found = program(tmp_path, main)
    assert found.may_publish_more
    assert found.publishes in ({"out": IMAGE}, None)


def test_files_of_which_nothing_can_be_said(tmp_path: Path) -> None:
    file = tmp_path / "nodes.py"
    assert read_node_source(file, "N") is None
    file.write_text("class N(:", encoding="utf-8")
    assert read_node_source(file, "N") is None
    file.write_text("def N(**kwargs): ...", encoding="utf-8")
    found = read_node_source(file, "N")
    assert found is not None
    assert found.publishes is None
    assert found.may_publish_more == "N is a function that returns a node"


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
        ("a: 1", "has no 'ros__parameters' below 'a'"),
        ("a: {ros__parameters: 1}", "has a 'ros__parameters' of 'a' that is not a map"),
        ("a: [", "is not YAML in line 2"),
        (
            "a: {ros__parameters: {x: !!python/object:os.system {}}}",
            "cannot be used: line 1: YAML tags are not supported",
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
