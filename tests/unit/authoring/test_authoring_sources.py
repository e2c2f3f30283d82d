"""`r2bspec init --from-...`: what the sources tell is in the spec, and the rest in comments."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest
import yaml

from ament_packages import install_package
from data_bags import text, write_bag
from golden import compare
from launch_specs import stored
from nightly import sampled
from r2bspec.api import compile_plan, load, validate
from r2bspec.authoring.draft_spec import Draft, DraftNodes
from r2bspec.authoring.draft_text import draft_text
from r2bspec.authoring.sources import add_graph_nodes
from r2bspec.cli.main import main
from transform_bags import write_transform_bag

HERE = Path(__file__).parent
CASES = yaml.safe_load((HERE / "first_specs.yaml").read_text(encoding="utf-8"))
NODE, COMPUTED = CASES["sources"]["bright"], CASES["sources"]["talker"]
PYTHON = """
from launch import LaunchDescription
from launch_ros.actions import Node


def generate_launch_description():
    return LaunchDescription([Node(name='light', package='cell_light', executable='light')])
"""


def made(*arguments: str) -> str:
    """The text of a spec, which is valid and has a plan."""
    assert main(["init", "made", *arguments]) == 0
    found = validate(Path("made.r2b.yaml"))
    assert [each.message for each in found if each.severity == "error"] == []
    assert compile_plan(Path("made.r2b.yaml")).name == "made"
    return Path("made.r2b.yaml").read_text()


def spec() -> Any:
    return load(Path("made.r2b.yaml"))


@pytest.mark.parametrize("name", CASES["specs"])
def test_what_is_known_is_written(name: str) -> None:
    """The specs are stored; with ``R2BSPEC_REWRITE=1`` they are written instead of compared."""
    case = CASES["specs"][name]
    content = CASES["sources"][case["source"]] if "source" in case else ""
    content = stored(case["launch"]) if "launch" in case else content
    for old, new in case.get("replace", {}).items():
        assert old in content
        content = content.replace(old, new)
    name_of_source = "cell.launch.py" if case.get("source") == "launch" else "node.py"
    Path(name_of_source if "source" in case else "a.launch.py").write_text(content)
    for file, written in case.get("files", {}).items():
        Path(file).write_text(written)
    # The fields of a type are known where its package is installed.
    text = re.sub(r" +# '(request|goal): .*\n", "", made(*case["init"]))
    compare(text, HERE / "first_specs" / f"{name}.r2b.yaml")


def test_no_template_with_sources() -> None:
    assert main(["init", "made", "--from-bag", "r2b_storage", "--template", "live"]) == 2
    assert not Path("made.r2b.yaml").exists()


@pytest.mark.parametrize("tf_ms", [[0, 50], []])
def test_a_node_that_reads_transforms_gets_the_recorded_ones(tf_ms: list[int]) -> None:
    made_listener = "        self.listener = TransformListener(Buffer(), self)\n"
    Path("node.py").write_text(NODE + made_listener)
    write_transform_bag(Path("moving"), [0, 100, 200], tf_ms, [("base", "lidar")])
    text = made("--from-bag", "./moving", "--node", "./node.py:Bright")
    assert spec().data_loader.publish_tf == bool(tf_ms)
    assert spec().data_loader.publish_tf_static
    assert "/tf_static" not in text.partition("Also recorded")[2].partition("topics:")[0]


@pytest.mark.parametrize(
    ("key", "namespace", "topic"),
    [
        ("talker", "/", "said"),
        ("/front/left/talker", "/", "front/left/said"),
        ("/r2b/talker", "r2b", "said"),
        ("/**", "r2b", "said"),
    ],
)
def test_a_node_with_a_file_of_its_parameters(key: str, namespace: str, topic: str) -> None:
    """It has the name that the file has, and the topics that the file names."""
    Path("node.py").write_text(COMPUTED)
    Path("own.yaml").write_text(f"{key}: {{ros__parameters: {{topic: said}}}}\n")
    made("--node", "./node.py:main", "--params-file", "own.yaml")
    assert spec().graph.nodes["talker"].parameter_files == ("./own.yaml",)
    assert [monitor.topic for monitor in spec().monitors.values()] == [topic]
    assert spec().namespace == namespace


def test_a_node_whose_topics_are_computed() -> None:
    """What is not known is said with the reason, and nothing is made up."""
    write_scans(Path("scans"), 10, 20)
    of_parameter = "self.get_parameter('topic').get_parameter_value().string_value"
    Path("node.py").write_text(COMPUTED.replace(of_parameter, "'-'.join(['a', 'b'])"))
    text = made("--node", "./node.py:Talker", "--from-bag", "./scans")
    assert list(spec().graph.nodes) == ["talker"]
    assert "whether talker publishes other topics: line " in text
    assert "what the nodes publish: the monitor is on /rosout until you name an output" in text


@pytest.mark.parametrize("hz", sampled([0.2, 1, 2, 5, 10, 11, 12, 30], 3))
@pytest.mark.parametrize("seconds", [1, 5, 60])
def test_a_bag_of_any_rate_has_messages_enough(hz: float, seconds: float) -> None:
    """The objective that is proposed is one that the messages of a run can confirm."""
    write_scans(Path("scans"), hz, max(2, round(hz * seconds)))
    made("--from-bag", "./scans")
    rate = spec().benchmark.rates[0].hz
    assert rate * spec().benchmark.duration.seconds * 10 >= 29


def write_scans(folder: Path, hz: float, count: int) -> None:
    write_bag(folder, [("/scan", round(n * 1e9 / hz), text("far")) for n in range(count)])


def test_an_environment_variable_that_is_not_set(monkeypatch: pytest.MonkeyPatch) -> None:
    """The spec needs it as the launch file does."""
    argument = "package='cell', arguments=[EnvironmentVariable('CELL_MODEL')]"
    content = PYTHON.replace("package='cell_light'", argument)
    imports = "from launch.substitutions import EnvironmentVariable\n"
    Path("a.launch.py").write_text(imports + content)
    assert main(["init", "made", "--from-launch", "a.launch.py"]) == 0
    said = "# - the environment variable CELL_MODEL: set it as where the file is launched\n"
    assert said in Path("made.r2b.yaml").read_text()
    Path("made.r2b.yaml").unlink()
    monkeypatch.setenv("CELL_MODEL", "small")
    assert said not in made("--from-launch", "a.launch.py")


def test_a_package(monkeypatch: pytest.MonkeyPatch) -> None:
    prefix = install_package(
        Path("prefix").absolute(), "cell", {"launch/one.launch.xml": "<launch/>"}
    )
    monkeypatch.setenv("AMENT_PREFIX_PATH", str(prefix))
    made("--from-launch", "cell")
    Path("made.r2b.yaml").unlink()
    install_package(prefix, "cell", {"launch/two.launch.py": PYTHON})
    assert main(["init", "made", "--from-launch", "cell"]) == 2
    made("--from-launch", "cell:two.launch.py")


def graph_node(name: str, namespace: str = "/", **more: Any) -> dict[str, Any]:
    empty: dict[str, Any] = {
        key: {} for key in ("subscribes", "publishes", "services", "qos", "parameters")
    }
    return {"name": name, "namespace": namespace, **empty, **more}


def test_a_graph() -> None:
    draft = DraftNodes()
    kind = "sensor_msgs/msg/Image"
    best = {"reliability": "best_effort", "durability": "volatile"}
    nodes = [
        graph_node("camera", publishes={"/image": kind}, qos={"/image": best}),
        graph_node(
            "detector",
            "/cell",
            subscribes={"/image": kind, "/tf": "tf2_msgs/msg/TFMessage"},
            publishes={"/cell/found": "std_msgs/msg/String"},
            parameters={"size": {"type": "double", "default": 0.5}},
        ),
        graph_node("detector", "/other"),
    ]
    add_graph_nodes(draft, nodes)
    Path("made.r2b.yaml").write_text(draft_text(Draft("made", draft, None, Path()), ["a graph"]))
    assert [each for each in validate(Path("made.r2b.yaml")) if each.severity == "error"] == []
    text = Path("made.r2b.yaml").read_text()
    assert re.search(r"/other/detector shares its name", text)
    assert list(spec().graph.nodes) == ["camera", "detector", "detector_2"]
    assert spec().graph.nodes["camera"].qos["/image"].reliability == "best_effort"
    assert spec().monitors["cell_found"].match == "order"
