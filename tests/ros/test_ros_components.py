"""C++ components in containers, as far as they are installed, and what is said where they are not.

The first tests put a program in the place of the container that is none: what they are about is
what a run makes of a container that cannot be had, dies, or does not answer. The last one loads
real components and runs where a full ROS 2 is installed.
"""

from __future__ import annotations

import os
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("rclpy")

from r2bspec.api import validate
from r2bspec.errors import R2bspecError
from r2bspec.execute.processes.prerequisites import find_executable
from ros_runs import Bench, relay_spec
from ros_runs import bench as bench


def installed(package: str, executable: str) -> bool:
    try:
        find_executable(package, executable)
    except R2bspecError:
        return False
    return True


FULL_ROS = find_spec("composition_interfaces") is not None and installed(
    "rclcpp_components", "component_container"
)

COMPONENT: dict[str, Any] = {"package": "image_tools", "plugin": "image_tools::Nothing"}


@pytest.fixture
def stands_in(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Any:
    """Puts a program in the place of the container."""

    def put(script: str) -> None:
        prefix = tmp_path / "prefix"
        index = prefix / "share/ament_index/resource_index/packages"
        program = prefix / "lib/rclcpp_components/component_container"
        for folder in (index, program.parent):
            folder.mkdir(parents=True)
        (index / "rclcpp_components").touch()
        program.write_text(f"#!/bin/sh\n{script}\n")
        program.chmod(0o755)
        known = os.environ.get("AMENT_PREFIX_PATH", "")
        monkeypatch.setenv("AMENT_PREFIX_PATH", f"{prefix}:{known}")

    return put


def with_component() -> dict[str, Any]:
    return relay_spec(graph={"nodes": {"rectify": COMPONENT}})


@pytest.mark.skipif(FULL_ROS, reason="containers are installed here")
def test_containers_that_are_not_installed_are_named_before_anything_starts(bench: Bench) -> None:
    done = bench.run(with_component())
    assert done.status == 2
    assert "R2B622" in done.error
    assert "'rclcpp_components' is not installed" in done.error


def test_a_container_that_dies_is_named_with_its_last_words(bench: Bench, stands_in: Any) -> None:
    stands_in("echo libcomponent.so: cannot open shared object file >&2; exit 127")
    done = bench.run(with_component())
    assert done.status == 4
    assert "process rectify exited with status 127" in done.error
    assert "cannot open shared object file" in done.error


@pytest.mark.skipif(find_spec("composition_interfaces") is not None, reason="it is installed here")
def test_without_the_interface_nothing_can_be_loaded(bench: Bench, stands_in: Any) -> None:
    stands_in("exec sleep 600")
    done = bench.run(with_component())
    assert done.status == 2
    assert "'composition_interfaces' is not installed" in done.error


@pytest.mark.skipif(not FULL_ROS, reason="needs rclcpp_components and composition_interfaces")
def test_a_component_that_is_none_is_named_with_what_its_container_says(bench: Bench) -> None:
    done = bench.run(with_component())
    assert done.status == 4
    assert "R2B665" in done.error
    for word in ("image_tools::Nothing", "package image_tools", "/rectify_container", "/rectify"):
        assert word in done.error


def with_talker() -> dict[str, Any]:
    """A component, remapped, in a container of several threads beside a relay that is measured."""
    spec = relay_spec()
    quiet = ["--ros-args", "--log-level", "warn"]
    spec["containers"] = {"cpp": {"executable": "component_container_mt", "arguments": quiet}}
    spec["graph"]["nodes"]["talker"] = {
        "package": "demo_nodes_cpp",
        "plugin": "demo_nodes_cpp::Talker",
        "remappings": {"chatter": "said"},
        "container": "cpp",
        "intra_process": True,
    }
    # A service of the node itself, which is there only once it has been loaded by this name.
    spec["ready"] = {"it_is_there": {"service": "talker/list_parameters"}}
    return spec


def test_the_spec_of_the_test_below_is_valid(bench: Bench) -> None:
    findings = validate(bench.write(with_talker()))
    assert [finding for finding in findings if finding.severity == "error"] == []


@pytest.mark.skipif(
    not (FULL_ROS and installed("demo_nodes_cpp", "talker")),
    reason="needs rclcpp_components, composition_interfaces and demo_nodes_cpp",
)
def test_components_that_are_there_are_loaded_and_take_part_in_readiness(bench: Bench) -> None:
    done = bench.run(with_talker())
    done.assert_complete()
    assert ("cpp", "container") in [(p.name, p.role) for p in done.run().record.processes]
