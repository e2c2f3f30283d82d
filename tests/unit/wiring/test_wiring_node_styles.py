"""Nodes of different styles are known from their source, and `init` writes specs of them."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest
import yaml

from node_styles import TARGETS, write_workspace
from r2bspec.check import check
from r2bspec.cli.main import main
from r2bspec.language.load_spec import load_spec
from r2bspec.plan.wiring.build_wiring import build_wiring
from r2bspec.plan.wiring.companion_files import read_companion_files, read_source
from r2bspec.plan.wiring.wiring import NodeWiring


@pytest.fixture(scope="module")
def bench(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A workspace as colcon has it, in no repository."""
    return write_workspace(tmp_path_factory.mktemp("workspace"))


def wired(file: Path) -> NodeWiring:
    """The node of a spec."""
    spec = load_spec(file).spec
    assert spec is not None
    files = read_companion_files(spec, file.parent)
    nodes = build_wiring(spec, companion_files=files).measure.nodes
    return next(node for node in nodes if node.node.python)


@pytest.mark.parametrize("style", TARGETS)
def test_init_writes_a_valid_spec_that_knows_the_topics(
    style: str,
    bench: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.chdir(bench)
    target, subscribed, published = TARGETS[style]
    file = bench / f"{style}.r2b.yaml"
    assert main(["init", str(bench / style), "--node", target]) == 0
    node = wired(file)
    assert node.interface.subscribes is not None
    assert node.interface.publishes is not None
    assert (set(node.interface.subscribes), set(node.interface.publishes)) == (
        subscribed,
        published,
    )
    monitored = {each["topic"] for each in yaml.safe_load(file.read_text())["monitors"].values()}
    assert monitored == published
    wrong = {each.code for each in check(load_spec(file)) if each.severity == "error"}
    assert not wrong
    capsys.readouterr()


def test_what_a_file_says_of_the_state_is_written(
    bench: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(bench)
    node = "./lidar_filter.py:LidarFilter"
    assert main(["init", str(bench / "state"), "--node", node]) == 0
    nodes = yaml.safe_load((bench / "state.r2b.yaml").read_text())["graph"]["nodes"]
    entry = next(node_plan for node_plan in nodes.values() if "python" in node_plan)
    assert entry == {"python": node, "lifecycle": "active"}


def test_a_base_class_in_another_file_of_the_package_is_read(bench: Path) -> None:
    interface, start = read_source("../src/drive_pkg/drive_pkg/driver_node.py:main", bench)
    assert set(interface.publishes or ()) == {"cmd"}
    assert interface.may_publish_more == ""
    assert set(interface.parameters or ()) == {"speed"}
    assert start == "main"


def test_classes_are_followed_through_the_files_of_a_package(tmp_path: Path) -> None:
    bench = write_workspace(tmp_path)
    (tmp_path / ".git").mkdir()
    package = tmp_path / "src/drive_pkg/drive_pkg"
    (package / "base.py").write_text(
        "from rclpy.node import Node\nfrom std_msgs.msg import Bool\n"
        "class BaseNode(Node):\n    def __init__(self, name):\n        super().__init__(name)\n"
        "        self.ready = self.create_publisher(Bool, 'ready', 1)\n"
    )
    (package / "entry.py").write_text(
        "import rclpy\nfrom drive_pkg.driver_node import Driver\n"
        "def main():\n    rclpy.init()\n    rclpy.spin(Driver())\n"
    )
    (package / "loop.py").write_text("from .loop import main\n")
    interface, _ = read_source("../src/drive_pkg/drive_pkg/entry.py:main", bench)
    assert set(interface.publishes or ()) == {"cmd", "ready"}
    assert set(interface.subscribes or ()) == {"goal"}
    interface, _ = read_source("../src/drive_pkg/drive_pkg/loop.py:main", bench)
    assert interface.publishes is None
    (tmp_path / ".git").rmdir()
    (package.parent / "package.xml").unlink()
    interface, _ = read_source("../src/drive_pkg/drive_pkg/entry.py:main", bench)
    assert interface.may_publish_more == (
        "../src/drive_pkg/drive_pkg/entry.py is not read: it is in no git work tree or colcon "
        "workspace with the spec"
    )


def test_a_node_of_which_nothing_is_known_is_said_to_be_so(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "nodes").mkdir()
    (tmp_path / "nodes" / "relay.py").write_text("class Relay: pass\n")
    (tmp_path / "bench").mkdir()
    assert main(["init", str(tmp_path / "bench/own"), "--node", "nodes/relay.py:Relay"]) == 0
    assert "this 'init' again with --probe" in capsys.readouterr().out
    text = (tmp_path / "bench/own.r2b.yaml").read_text()
    assert "whether relay publishes other topics: ../nodes/relay.py is not read: it is in" in text


def test_the_function_of_an_installed_script_is_known(tmp_path: Path) -> None:
    source = write_workspace(tmp_path).parent / "src" / "drive_pkg"
    metadata = source / "drive_pkg-0.1.0.dist-info"
    metadata.mkdir()
    (metadata / "METADATA").write_text("Metadata-Version: 2.1\nName: drive-pkg\nVersion: 0.1.0\n")
    (metadata / "entry_points.txt").write_text(
        "[console_scripts]\ndriver = drive_pkg.driver_node:main\n"
    )
    program = (
        "from r2bspec.plan.wiring.console_scripts import installed_script\n"
        "print([installed_script('drive_pkg', name) for name in ('driver', 'other')])"
    )
    done = subprocess.run(
        [sys.executable, "-c", program],
        env={"PYTHONPATH": str(source)},
        capture_output=True,
        text=True,
        check=True,
    )
    assert done.stdout.strip() == "['drive_pkg.driver_node.main', '']"


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("setup.py", 'setup(entry_points={"console_scripts": [f"{name}_x = {name}.node:main"]})'),
        ("setup.cfg", "[options.entry_points]\nconsole_scripts =\n  pkg_x = pkg.node:main\n"),
        ("pyproject.toml", '[project]\nname = "pkg"\n[project.scripts]\npkg_x = "pkg.node:main"\n'),
    ],
)
def test_every_way_to_declare_a_script_is_read(name: str, text: str, tmp_path: Path) -> None:
    package = tmp_path / "src" / "robot" / "pkg"
    (package / "pkg").mkdir(parents=True)
    (package / "package.xml").write_text("<package><name>pkg</name></package>")
    (package / "pkg" / "node.py").write_text("def main(): ...\n")
    (package / name).write_text(text)
    bench = tmp_path / "bench"
    bench.mkdir()
    (tmp_path / ".git").mkdir()
    assert main(["init", str(bench / "x"), "--node", "pkg:pkg_x"]) == 0
    text = (bench / "x.r2b.yaml").read_text()
    assert "../src/robot/pkg/pkg/node.py:main" in text
