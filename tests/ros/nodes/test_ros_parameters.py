"""Values that a parameter may not have are refused by name, before anything runs."""

from __future__ import annotations

import re
from typing import Any

import pytest

pytest.importorskip("rclpy")
pytest.importorskip("cv2")

from node_graph import node_graph

import r2bspec.nodes


@pytest.mark.parametrize(
    ("node", "parameters", "words"),
    [
        ("AprilTagNode", {"family": "36h12"}, "one of 16h5, 25h9, 36h10, 36h11; it is '36h12'"),
        ("AprilTagNode", {"family": 36}, "'family' must be a string"),
        ("AprilTagNode", {"size": 0.0}, "'size' must be a double, above 0; it is 0.0"),
        ("AprilTagNode", {"size": float("nan")}, "'size' must be a double, above 0; it is nan"),
        ("AprilTagNode", {"size": 1}, "'size' must be a double, above 0"),
        ("ResizeNode", {"width": 0}, "'width' must be an integer, 1 or more, or -1"),
        ("ResizeNode", {"height": -2}, "'height' must be an integer, 1 or more, or -1"),
        ("ResizeNode", {"scale_width": -0.5}, "'scale_width' must be a double, above 0"),
        ("ResizeNode", {"scale_height": float("inf")}, "'scale_height' must be a double, above 0"),
        ("ResizeNode", {"interpolation": 5}, "one of 0, 1, 2, 3, 4; it is 5"),
        ("ResizeNode", {"use_scale": "yes"}, "'use_scale' must be a bool, true or false"),
        ("RelayNode", {"format": "Image"}, "'format': 'Image' is not a message type such as"),
        ("RelayNode", {"format": "no_msgs/msg/Image"}, "package no_msgs is not installed"),
        ("RelayNode", {"format": "std_msgs/msg/Strng"}, "std_msgs has no message Strng"),
        ("RelayNode", {"service_time_ms": -1.0}, "'service_time_ms' must be a double, 0 or more"),
        ("RelayNode", {"jitter": "some"}, "one of none, exponential; it is 'some'"),
        ("RelayNode", {"seed": -1}, "'seed' must be an integer, 0 or more"),
        ("RelayNode", {"queue_depth": 0}, "'queue_depth' must be an integer, 1 or more"),
    ],
)
def test_a_bad_value_is_refused_with_the_allowed_ones(
    node: str, parameters: dict[str, Any], words: str
) -> None:
    with node_graph() as graph:
        with pytest.raises(ValueError, match=re.escape(words)) as refused:
            graph.add(getattr(r2bspec.nodes, node), parameters=parameters)
        assert f"parameter '{next(iter(parameters))}'" in str(refused.value)
        assert graph.tester.get_node_names() == ["tester"]


def test_a_parameter_is_fixed_once_the_node_runs() -> None:
    with node_graph() as graph:
        relay = graph.add(r2bspec.nodes.RelayNode)
        parameter = relay.get_parameter("jitter")
        (result,) = relay.set_parameters([parameter])
    assert not result.successful
    assert "read-only" in result.reason
