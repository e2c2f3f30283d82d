"""interfaces.yaml says of the nodes what the nodes say of themselves."""

from __future__ import annotations

import importlib
from importlib import resources
from typing import Any

import pytest
import yaml

pytest.importorskip("rclpy")
pytest.importorskip("cv2")

from node_graph import node_graph
from rcl_interfaces.msg import ParameterType

import r2bspec.nodes

_STATED: dict[str, Any] = yaml.safe_load(
    resources.files("r2bspec.nodes").joinpath("interfaces.yaml").read_text("utf-8")
)
_TYPES = {
    ParameterType.PARAMETER_BOOL: "bool",
    ParameterType.PARAMETER_INTEGER: "integer",
    ParameterType.PARAMETER_DOUBLE: "double",
    ParameterType.PARAMETER_STRING: "string",
}
# What rclpy gives to every node.
_EVERY_NODES_TOPICS = {"/rosout", "/parameter_events"}
_EVERY_NODES_PARAMETERS = {"use_sim_time", "start_type_description_service"}


def test_every_node_is_stated() -> None:
    assert sorted(_STATED) == [f"r2bspec.nodes.{name}" for name in sorted(r2bspec.nodes.__all__)]


@pytest.mark.parametrize("path", _STATED)
def test_the_statement_is_what_the_node_declares(path: str) -> None:
    stated = _STATED[path]
    module, _, name = path.rpartition(".")
    with node_graph() as graph:
        node = graph.add(getattr(importlib.import_module(module), name))

        def found(names_and_types: list[tuple[str, list[str]]]) -> dict[str, str]:
            topics = {topic: types[0] for topic, types in names_and_types}
            return {
                topic.removeprefix("/"): kind
                for topic, kind in topics.items()
                if topic not in _EVERY_NODES_TOPICS
            }

        def subscribes() -> dict[str, str]:
            return found(node.get_subscriber_names_and_types_by_node(node.get_name(), "/"))

        def publishes() -> dict[str, str]:
            return found(node.get_publisher_names_and_types_by_node(node.get_name(), "/"))

        graph.spin_until(lambda: len(subscribes()) + len(publishes()) >= _stated_topics(stated))
        assert subscribes() == _resolved(stated, "subscribes")
        assert publishes() == _resolved(stated, "publishes")

        names = set(node.list_parameters([], 0).names) - _EVERY_NODES_PARAMETERS
        described = {
            describe_parameter.name: (
                _TYPES[describe_parameter.type],
                node.get_parameter(describe_parameter.name).value,
            )
            for describe_parameter in node.describe_parameters(sorted(names))
        }
    assert described == {
        name: (one["type"], one["default"]) for name, one in stated["parameters"].items()
    }


def _stated_topics(stated: dict[str, Any]) -> int:
    return len(stated["subscribes"]) + len(stated["publishes"])


def _resolved(stated: dict[str, Any], direction: str) -> dict[str, str]:
    values = {name: one["default"] for name, one in stated["parameters"].items()}

    def resolve(kind: str) -> str:
        name = kind.removeprefix("$(parameter ").removesuffix(")")
        return str(values[name]) if kind.startswith("$(") else kind

    return {topic: resolve(kind) for topic, kind in stated[direction].items()}
