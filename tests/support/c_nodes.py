"""The nodes of tests/ros/nodes_c, built for the ROS that is installed."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import Any

import pytest

from r2bspec.native.build import BuildError, build, find_compiler, find_ros
from ros_runs import IMAGE

_SOURCES = Path(__file__).parents[1] / "ros/nodes_c"
_LIBRARIES = (
    *("-lrcl", "-lrcutils", "-lrcl_yaml_param_parser", "-pthread"),
    *("-lsensor_msgs__rosidl_typesupport_c", "-lsensor_msgs__rosidl_generator_c"),
)


@cache
def c_node(name: str) -> Path:
    """The program of a node, built once; skips the test where no C can be compiled."""
    try:
        compiler, ros = find_compiler(), find_ros()
    except BuildError as missing:
        pytest.skip(f"{missing}")
    return build(
        name,
        [_SOURCES / f"{name}.c", _SOURCES / "image_node.c"],
        ros,
        kind="program",
        compiler=compiler,
        packages=("sensor_msgs", "std_msgs"),
        libraries=_LIBRARIES,
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
