"""Rules about what lies beside a spec, or on this machine, and so in no example."""

from __future__ import annotations

from pathlib import Path

import pytest
from check_specs import codes, findings

from ament_packages import install_package
from example_spec import example
from r2bspec.diagnostics import Certainty


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


def test_several_recordings_are_one(tmp_path: Path, spec_file: str) -> None:
    loader = "{bags: [r2b_storage, r2b_lounge], topics: {/d455_1_rgb_image: image_raw}}"
    assert codes(example(data_loader=loader), file=spec_file) == []
    broken = loader.replace("r2b_lounge", "./nowhere")
    (found,) = findings(example(data_loader=broken), file=spec_file)
    assert (found.code, found.path) == ("R2B301", ("data_loader", "bags", 1))
