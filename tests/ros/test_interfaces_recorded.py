"""``r2bspec interfaces``: what is recorded of real nodes is what they really have."""

from __future__ import annotations

from pathlib import Path

import pytest

pytest.importorskip("rclpy")

from click.testing import CliRunner, Result

from r2bspec.check import check
from r2bspec.cli.authoring import interfaces_command as command
from r2bspec.cli.main import main
from r2bspec.language.load_spec import load_spec
from r2bspec.plan.wiring.companion_files import read_companion_files

IMAGE = "sensor_msgs/msg/Image"
NODES = '''
from rcl_interfaces.srv import ListParameters
from rclpy.node import Node
from rclpy.qos import qos_profile_sensor_data
from sensor_msgs.msg import Image


def make(**kwargs):
    """A node of which its file says nothing literally."""
    node = Node("any", **kwargs)
    count = node.declare_parameter("cameras", 1).value
    node.declare_parameter("gain", 0.5)
    for index in range(count):
        node.create_subscription(Image, f"camera{index}", lambda _: None, qos_profile_sensor_data)
    node.create_publisher(Image, "merged", 10)
    node.create_publisher(Image, "~/preview", 10)
    node.create_service(ListParameters, "reset", lambda request, response: response)
    return node


def broken(**kwargs):
    raise RuntimeError("no camera")
'''
SPEC = Path(__file__).with_name("interfaces.r2b.yaml").read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Result]:
    """The spec, and what the command has said of it."""
    folder = tmp_path_factory.mktemp("interfaces")
    (folder / "nodes.py").write_text(NODES, encoding="utf-8")
    file = folder / "spec.r2b.yaml"
    file.write_text(SPEC, encoding="utf-8")
    return file, CliRunner().invoke(command, [str(file)], standalone_mode=False)


def test_topics_profiles_services_and_parameters_are_recorded(
    recorded: tuple[Path, Result],
) -> None:
    spec, _ = recorded
    loaded = load_spec(spec)
    assert loaded.spec is not None
    found = read_companion_files(loaded.spec, spec.parent).interfaces["merge"]
    origin = found.recorded_from
    assert origin is not None
    assert origin.target == "./nodes.py:make"
    assert len(origin.sha256) == 64
    assert found.subscribes == {"camera0": IMAGE, "camera1": IMAGE}
    assert found.publishes == {"merged": IMAGE, "~/preview": IMAGE}
    assert found.services == {"reset": "rcl_interfaces/srv/ListParameters"}
    assert found.qos["camera0"].reliability == "best_effort"
    assert found.qos["merged"].reliability == "reliable"
    assert found.parameters is not None
    assert {name: each.type for name, each in found.parameters.items()} == {
        "cameras": "integer",
        "gain": "double",
    }
    assert found.parameters["gain"].default == 0.5
    assert found.parameters["cameras"].default is None, "the spec decided that"


def test_a_node_that_cannot_be_made_is_told_and_the_others_are_recorded(
    recorded: tuple[Path, Result],
) -> None:
    spec, done = recorded
    assert done.return_value == 4
    assert "no camera" in done.stderr
    assert sorted(each.name for each in (spec.parent / "interfaces").iterdir()) == ["merge.yaml"]


def test_what_was_recorded_is_what_rules_go_by(recorded: tuple[Path, Result]) -> None:
    spec, _ = recorded
    text = spec.read_text(encoding="utf-8").replace("    broken: {python: ./nodes.py:broken}\n", "")
    assert check(load_spec(text, file=str(spec))) == []
    wrong = text.replace("cameras: 2", "cameras: 2, gian: 1.0").replace("camera1:", "camera3:")
    assert {each.code for each in check(load_spec(wrong, file=str(spec)))} == {"R2B204", "R2B211"}


def test_init_starts_a_node_whose_source_does_not_tell_its_topics(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("merge.py").write_text(NODES, encoding="utf-8")
    given = ["init", "first", "--node", "./merge.py:make"]
    assert main(given) == 0
    assert "again with --probe" in capsys.readouterr().out
    Path("first.r2b.yaml").unlink()
    assert main([*given, "--probe"]) == 0
    said = capsys.readouterr().out
    assert "interfaces/" in said
    assert "not known" not in said
    assert "topic: merged" in Path("first.r2b.yaml").read_text(encoding="utf-8")
    assert main(["validate", "first.r2b.yaml"]) == 0
