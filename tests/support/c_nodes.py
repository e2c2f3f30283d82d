"""The nodes of tests/ros/nodes_c, built for the ROS that is installed."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import Any

import pytest

from r2bspec.native.build import BuildError, build, find_compiler, find_ros
from ros_runs import IMAGE

_SOURCES = Path(__file__).parents[1] / "ros/nodes_c"
_SHARED = {"sensor_msgs": ("image_node",)}
"""What nodes of these messages have in common."""

_LIBRARIES = ("-lrcl", "-lrcutils", "-lrcl_yaml_param_parser", "-pthread")


@cache
def c_node(name: str, messages: str = "sensor_msgs", *packages: str) -> Path:
    """The program of a node, built once; skips the test where no C can be compiled.

    With messages of another package it is no node of images, and has one file. Of further packages
    it has the headers, and the library of the first.
    """
    try:
        compiler, ros = find_compiler(), find_ros()
    except BuildError as missing:
        pytest.skip(f"{missing}")
    return build(
        name,
        [_SOURCES / f"{each}.c" for each in (name, *_SHARED.get(messages, ()))],
        ros,
        kind="program",
        compiler=compiler,
        packages=(messages, "std_msgs", *packages),
        libraries=(
            *_LIBRARIES,
            *(f"-l{package}" for package in packages[:1]),
            *(f"-l{messages}__rosidl_{each}_c" for each in ("typesupport", "generator")),
        ),
    )


def c_node_spec(name: str, **changes: Any) -> dict[str, Any]:
    """A node as a spec declares it; its queue outlasts long hiccups of the machine."""
    node: dict[str, Any] = {
        "command": [str(c_node(name))],
        "subscribes": {"input": IMAGE},
        "publishes": {"output": IMAGE},
    }
    parameters = {"queue_depth": 100} | changes.pop("parameters", {})
    return node | {"parameters": parameters} | changes
