"""Rules about what lies beside a spec, or on this machine, and so in no example."""

from __future__ import annotations

from pathlib import Path

import pytest
from check_specs import codes, findings, write_bag

from ament_packages import install_package
from example_spec import example
from r2bspec.check.check_context import cached_index
from r2bspec.datasets.catalogue import locate as locate_bag
from r2bspec.diagnostics import Certainty
from r2bspec.plan.launch_programs import launch_programs

COMPANIONS = Path(__file__).parents[2] / "golden" / "check" / "companions"


def relay(fields: str, **sections: str) -> str:
    """The example with a relay that has further fields."""
    graph = (
        "nodes: {relay: {python: r2bspec.nodes.RelayNode, remappings: {input: image}, "
        f"{fields}}}}}"
    )
    return example(graph=graph, **sections)


@pytest.fixture
def spec_file(tmp_path: Path) -> str:
    return str(tmp_path / "spec.r2b.yaml")


@pytest.mark.parametrize(
    ("key", "container", "expected"),
    [("a", "", []), ("rectify_container", "", ["R2B215"]), ("rectify_container", "c", [])],
)
def test_names_that_a_plan_gives_to_containers(
    key: str, container: str, expected: list[str], spec_file: str
) -> None:
    inside = f"container: {container}, " if container else ""
    graph = f"""
        nodes:
          rectify: {{package: image_proc, plugin: image_proc::RectifyNode, {inside}
            remappings: {{image_rect: rect}}}}
          {key}: {{python: r2bspec.nodes.RelayNode, remappings: {{input: rect}}}}
    """
    text = example(containers="{c: {}}" if container else "{}", graph=graph)
    found = set(codes(text, file=spec_file)) - {"R2B622", "R2B207"}
    assert found == set(expected)


def test_a_component_that_a_well_known_package_does_not_have(spec_file: str) -> None:
    graph = "nodes: {r: {package: image_proc, plugin: image_proc::RectifyNod}}"
    found = {each.code: each for each in findings(example(graph=graph), file=spec_file)}
    assert found["R2B639"].help == "did you mean 'image_proc::RectifyNode'?"
    assert found["R2B639"].certainty is Certainty.ENVIRONMENT


def test_the_components_of_an_installed_package_are_known(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, spec_file: str
) -> None:
    install_package(tmp_path, "mine", rclcpp_components="mine::Blur;lib/libmine.so\n")
    monkeypatch.setenv("AMENT_PREFIX_PATH", str(tmp_path))
    graph = "nodes: {{r: {{package: mine, plugin: 'mine::{}'}}}}"

    def found(plugin: str) -> dict[str, str]:
        text = example(graph=graph.format(plugin))
        return {each.code: each.help for each in findings(text, file=spec_file)}

    assert found("Blurr")["R2B639"] == "did you mean 'mine::Blur'?"
    assert "R2B639" not in found("Blur")


@pytest.mark.parametrize(
    ("kind", "text"),
    [
        ("xml", "<launch><include file='$(dirname)/other.launch.xml'/></launch>"),
        ("xml", "<launch><node pkg='nav' exec='$(var which)' name='first'/></launch>"),
        ("xml", "<!DOCTYPE launch><launch/>"),
        ("yaml", "launch: [{executable: {cmd: ./secnd}}]"),
        ("py", "from launch_ros.actions import Node\nNode(executable='a', **more())"),
        ("py", "from launch_ros.actions import Node\nmap(Node, ())"),
        (
            "py",
            "from launch_ros.actions import Node\n"  # noqa: ISC004
            "Node(executable='a', ros_arguments=['-r', '__node:=b'])",
        ),
        ("xml", "<launch><node pkg='nav' exec='a' args='--ros-args -r __name:=b'/></launch>"),
        ("py", "from launch_ros.actions import *\nNode(executable='a')"),
        ("py", "from bringup import nodes\nnodes()"),
        ("py", "from launch.actions import OpaqueFunction\nOpaqueFunction(function=print)"),
        ("py", "("),
    ],
)
def test_programs_that_the_text_does_not_say_are_found_at_the_start(
    kind: str, text: str, tmp_path: Path
) -> None:
    file = tmp_path / f"nav.launch.{kind}"
    file.write_text(text)
    assert launch_programs(file, tmp_path) is None
    file.write_text((COMPANIONS / file.name).read_text())
    assert launch_programs(file, tmp_path) is not None
    assert launch_programs(file, tmp_path / "elsewhere") is None


@pytest.mark.parametrize(
    ("topic", "env", "placement", "expected"),
    [
        ("/hawk_0_left_rgb_image", "{}", "graph", {"R2B418"}),
        ("/hawk_0_left_rgb_image", "{MALLOC_TRIM_THRESHOLD_: '1073741824'}", "graph", set()),
        ("/hawk_0_left_rgb_image", "{}", "separate", set()),
        ("/d455_1_rgb_image", "{}", "graph", set()),
        ("/d455_1_rgb_image", "{}", "separate", {"R2B673"}),
    ],
)
def test_placement_of_the_harness_is_advised_by_node_kind_and_size(
    topic: str, env: str, placement: str, expected: set[str]
) -> None:
    text = example(
        harness=f"{{placement: {placement}}}",
        containers=f"{{vision: {{executable: python, env: {env}}}}}",
        data_loader=f"{{bag: r2b_storage, topics: {{{topic}: image_raw}}}}",
        graph="nodes: {relay: {python: r2bspec.nodes.RelayNode, container: vision, "
        "remappings: {input: image}}, second: {python: r2bspec.nodes.RelayNode, "
        "container: vision, remappings: {input: output, output: other}}}",
    )
    assert {code for code in codes(text) if code in {"R2B418", "R2B673"}} == expected


def test_more_shared_memory_than_there_is(spec_file: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("r2bspec.plan.this_machine.shared_memory_bytes", lambda: 64 << 20)
    text = example(transport="{kind: shared_memory, segment: 32 MiB}")
    (found,) = findings(text, file=spec_file)
    assert (found.code, found.certainty) == ("R2B629", Certainty.ENVIRONMENT)


def test_a_launch_file_of_a_package_is_looked_up(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, spec_file: str
) -> None:
    install_package(tmp_path, "cameras", {"launch/camera.launch.py": ""})
    monkeypatch.setenv("AMENT_PREFIX_PATH", str(tmp_path))

    def said(file: str) -> list[str]:
        graph = f"""
            nodes:
              camera:
                launch: {{package: cameras, file: {file}}}
                subscribes: {{image: sensor_msgs/msg/Image}}
                publishes: {{output: sensor_msgs/msg/Image}}
        """
        return codes(example(graph=graph), file=spec_file)

    program = tmp_path / "bin" / "ros2"
    program.parent.mkdir()
    monkeypatch.setenv("PATH", str(program.parent))
    assert said("camera.launch.py") == ["R2B621"]
    program.touch(mode=0o755)
    assert said("camera.launch.py") == []
    assert said("camra.launch.py") == ["R2B613"]


def test_indexes_of_large_bags_are_kept_until_a_file_changes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    bag = write_bag(tmp_path / "bag", {"/talk": [0, 1]})
    location = locate_bag("./bag", tmp_path)
    cached_index(location)
    assert not (tmp_path / "cache").exists(), "small bags are not worth it"
    monkeypatch.setattr("r2bspec.check.check_context._MIN_CACHED_BYTES", 1)
    first = cached_index(location)
    (entry,) = (tmp_path / "cache/r2bspec/indexes").iterdir()
    assert cached_index(location) == first
    entry.write_text("damaged", encoding="utf-8")
    assert cached_index(location) == first
    next(bag.glob("*.mcap")).unlink()
    with pytest.raises(Exception, match=r"mcap"):
        cached_index(location)


def test_several_recordings_are_one(tmp_path: Path, spec_file: str) -> None:
    loader = "{bags: [r2b_storage, r2b_lounge], topics: {/d455_1_rgb_image: image_raw}}"
    assert codes(example(data_loader=loader), file=spec_file) == []
    broken = loader.replace("r2b_lounge", "./nowhere")
    (found,) = findings(example(data_loader=broken), file=spec_file)
    assert (found.code, found.path) == ("R2B301", ("data_loader", "bags", 1))


@pytest.mark.parametrize(
    ("rmw", "transport", "refused"),
    [
        ("rmw_cyclonedds_cpp", "shared_memory", True),
        ("rmw_zenoh_cpp", "udp", True),
        ("rmw_zenoh_cpp", "{kind: udp}", True),
        ("rmw_zenoh_cpp", "inherit", False),
        ("", "shared_memory", False),
        ("rmw_fastrtps_cpp", "udp", False),
        ("rmw_fastrtps_dynamic_cpp", "inherit", False),
    ],
)
def test_a_transport_that_the_selected_middleware_does_not_have_is_refused(
    rmw: str, transport: str, refused: bool, spec_file: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("RMW_IMPLEMENTATION", rmw)
    found = findings(example(transport=transport), file=spec_file)
    assert [each.code for each in found] == ["R2B666"] * refused
    for each in found:
        assert (each.severity, each.certainty) == ("error", Certainty.ENVIRONMENT)
        assert (each.path, each.span.line) == (("transport",), 3)
        assert f"with {rmw}, which RMW_IMPLEMENTATION selects here" in each.message


def test_a_node_that_selects_its_own_middleware_is_refused_at_its_place(spec_file: str) -> None:
    (found,) = findings(relay("env: {RMW_IMPLEMENTATION: rmw_zenoh_cpp}"), file=spec_file)
    assert (found.code, found.certainty) == ("R2B666", Certainty.CERTAIN)
    assert found.path[-2:] == ("env", "RMW_IMPLEMENTATION")
