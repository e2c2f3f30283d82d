"""The request that loads a component into a container, and the interpretation of the response.

The service is ``load_node`` of rclcpp_components, which ``ros2 component load`` also uses.
"""

from __future__ import annotations

from typing import Any

from r2bspec.plan.plan import NodePlan

LOAD_NODE_TYPE = "composition_interfaces/srv/LoadNode"

_SCALARS = {bool: (1, "bool"), int: (2, "integer"), float: (3, "double"), str: (4, "string")}
"""rcl_interfaces/msg/ParameterType: the number of a type, and the field that holds its value."""

_ARRAYS = {bool: (6, "bool"), int: (7, "integer"), float: (8, "double"), str: (9, "string")}


class ComponentError(Exception):
    """A component was not loaded; the message is for the user."""

    code = "R2B665"

    def __init__(self, message: str, hint: str = "", code: str = "") -> None:
        super().__init__(message)
        self.code = code or self.code
        self.hint = hint


def load_service_name(container: str) -> str:
    """The service of a container, by the full name of its node."""
    return f"{container}/_container/load_node"


def load_request(node: NodePlan) -> dict[str, Any]:
    """The fields of ``composition_interfaces/srv/LoadNode`` for a node of a plan.

    Raises:
        ComponentError: a parameter has no type of ROS.
    """
    return {
        "package_name": node.package,
        "plugin_name": node.plugin,
        "node_name": node.node,
        "node_namespace": node.namespace,
        "remap_rules": [f"{left}:={right}" for left, right in node.remappings.items()],
        "parameters": [
            {"name": name, "value": _parameter_value(node, name, value)}
            for name, value in node.parameters.items()
        ],
    }


def _parameter_value(node: NodePlan, name: str, value: Any) -> dict[str, Any]:
    """A value as rcl_interfaces/msg/ParameterValue. The numbers of a list have one type."""
    if isinstance(value, list):
        kinds = {type(each) for each in value}
        if kinds == {int, float}:
            kinds, value = {float}, [float(each) for each in value]
        if len(kinds) == 1 and (kind := kinds.pop()) in _ARRAYS:
            number, field = _ARRAYS[kind]
            return {"type": number, f"{field}_array_value": value}
    elif type(value) in _SCALARS:
        number, field = _SCALARS[type(value)]
        return {"type": number, f"{field}_value": value}
    raise ComponentError(
        f"parameter {name!r} of {node.name} cannot be {value!r}: a list needs at least one "
        "value, and values of one type",
        hint="Remove it to use the default.",
    )


def load_error(node: NodePlan, container: str, success: bool, reason: str) -> str:
    """The error of a response, for the user; empty if the component was loaded."""
    if success:
        return ""
    return (
        f"{node.plugin} of package {node.package} was not loaded into container {container} "
        f"as {node.name}: {reason or 'the container gave no reason'}"
    )
