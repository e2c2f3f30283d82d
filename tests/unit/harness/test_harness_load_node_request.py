"""What a component container is asked, and what is made of its answers."""

from __future__ import annotations

from typing import Any

import pytest

from plans import node_plan

pytest.importorskip("rclpy")

from r2bspec.harness.service_client import ComponentError, load_request
from r2bspec.language.spec import Container
from r2bspec.plan.command_lines import container_argv, container_node_name
from r2bspec.plan.plan import NodePlan


def node(**changes: Any) -> NodePlan:
    of = {"package": "image_proc", "plugin": "image_proc::RectifyNode"}
    return node_plan("rectify", namespace="/r2b/left", **of, **changes)


def value(given: Any) -> dict[str, Any]:
    (parameter,) = load_request(node(parameters={"p": given}))["parameters"]
    assert parameter["name"] == "p"
    found: dict[str, Any] = parameter["value"]
    return found


def test_a_component_is_named_placed_and_remapped() -> None:
    asked = load_request(node(remappings={"image": "left/image", "~/out": "rect"}))
    assert asked == {
        "package_name": "image_proc",
        "plugin_name": "image_proc::RectifyNode",
        "node_name": "rectify",
        "node_namespace": "/r2b/left",
        "remap_rules": ["image:=left/image", "~/out:=rect"],
        "parameters": [],
        "extra_arguments": [],
    }


# Numbers and fields as in rcl_interfaces/msg/ParameterType and ParameterValue.
@pytest.mark.parametrize(
    ("given", "expected"),
    [
        (True, {"type": 1, "bool_value": True}),
        (7, {"type": 2, "integer_value": 7}),
        (7.0, {"type": 3, "double_value": 7.0}),
        ("7", {"type": 4, "string_value": "7"}),
        ([True, False], {"type": 6, "bool_array_value": [True, False]}),
        ([1, 2], {"type": 7, "integer_array_value": [1, 2]}),
        ([1, 2.5], {"type": 8, "double_array_value": [1.0, 2.5]}),
        (["a"], {"type": 9, "string_array_value": ["a"]}),
    ],
)
def test_a_parameter_keeps_the_type_that_it_has_in_the_spec(
    given: Any, expected: dict[str, Any]
) -> None:
    assert value(given) == expected


@pytest.mark.parametrize("given", [[], [1, "a"], [True, 1], [[1]], {"a": 1}, None])
def test_what_ros_cannot_hold_is_refused_by_name(given: Any) -> None:
    with pytest.raises(ComponentError, match="parameter 'p' of /r2b/left/rectify cannot be"):
        value(given)


@pytest.mark.parametrize(
    ("namespace", "full"), [("/r2b", "/r2b/front"), ("/", "/front"), ("/a/b", "/a/b/front")]
)
def test_a_container_is_called_by_the_name_that_it_is_started_with(
    namespace: str, full: str
) -> None:
    argv = container_argv("front", Container(executable="component_container_mt"), namespace)
    assert container_node_name(argv) == full
