"""Calls of services: by an `after_ready` step, and to load C++ components.

Components are loaded into their containers as by ``ros2 component load``, with the service
``load_node`` of rclcpp_components: its request is made from a node of the plan, and its response is
put into words for the user.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from rclpy.node import Node

from r2bspec.errors import R2bspecError
from r2bspec.harness import rclpy_tools
from r2bspec.harness.control_channel import Channel
from r2bspec.harness.request_fields import FieldTypes, field_mistakes
from r2bspec.ipc import protocol
from r2bspec.plan.plan import NodePlan


class ServiceCallError(R2bspecError):
    """A call cannot be made or gets no response."""

    code = "R2B647"


def fill_message(message: Any, values: dict[str, Any]) -> Any:
    """Set the fields of a message from a mapping, nested messages from nested mappings.

    Raises:
        ServiceCallError: a field does not exist, or a value has the wrong type.
    """
    # Messages do not check the types of their fields by default, and would fail when sent.
    for mistake in field_mistakes(values, message.get_fields_and_field_types(), _fields_of):
        more = f"; {mistake.help}" if mistake.help else ""
        raise ServiceCallError(f"{mistake.where} of the request: {mistake.message}{more}")
    return _fill(message, values)


def _fields_of(type_name: str) -> FieldTypes:
    fields: FieldTypes = _message_class(type_name).get_fields_and_field_types()
    return fields


def _message_class(type_name: str) -> Any:
    package, _, name = type_name.partition("/")
    return rclpy_tools.interface_class(f"{package}/msg/{name}")


def _fill(message: Any, values: dict[str, Any]) -> Any:
    fields = message.get_fields_and_field_types()
    for name, value in values.items():
        setattr(message, name, _field_value(getattr(message, name), fields[name], value))
    return message


def _field_value(current: Any, type_name: str, value: Any) -> Any:
    """Return the value of a field that fits; mappings are converted to messages."""
    if isinstance(value, dict):
        return _fill(current, value)
    if isinstance(value, list) and value and isinstance(value[0], dict):
        element = type_name.removeprefix("sequence<").split("<")[-1].split("[")[0]
        make = _message_class(element.rstrip(">").split(",")[0])
        return [_fill(make(), fields) for fields in value]
    if isinstance(value, list) and type_name.startswith(
        ("float", "double", "sequence<float", "sequence<double")
    ):
        return [float(each) for each in value]
    return float(value) if type(current) is float else value


def call_service(
    node: Node,
    type_name: str,
    service: str,
    request: dict[str, Any],
    timeout_ns: int,
    interrupted: Callable[[], bool] = lambda: False,
) -> Any:
    """Wait for a service, call it, and wait for its response.

    Args:
        node: makes the call; no executor may spin it.
        type_name: such as ``std_srvs/srv/Trigger``.
        service: its full name.
        request: the fields of the request; others keep their defaults.
        timeout_ns: how long all of that may take.
        interrupted: whether the answer is not needed any more.

    Raises:
        TypeNotFoundError: its type is not installed.
        ServiceCallError: the service does not exist, does not accept the request, or does not
            respond in time.
    """
    kind = rclpy_tools.interface_class(type_name)
    message = fill_message(kind.Request(), request)
    answers = rclpy_tools.ask_services(
        node, kind, [service], timeout_ns / 1e9, message, interrupted
    )
    if service in answers:
        return answers[service]
    exists = any(name == service for name, _ in node.get_service_names_and_types())
    lacks = "did not respond in time" if exists else "does not exist"
    raise ServiceCallError(f"service {service} {lacks}")


class ServiceCaller:
    """Waits for a service, calls it once, and reports the response."""

    def __init__(self, channel: Channel, settings: protocol.ConfigureCaller) -> None:
        self._channel = channel
        self._settings = settings
        self._node: Node = rclpy_tools.start_node("caller")

    def serve(self) -> None:
        """Make the call; `Called` follows `Ready`.

        Raises:
            TypeNotFoundError: its type is not installed.
            ServiceCallError: the service does not exist, or does not respond in time.
        """
        self._channel.send(protocol.Ready())
        asked = self._settings
        call_service(self._node, asked.service_type, asked.service, asked.request, asked.timeout_ns)
        self._channel.send(protocol.Called())
        self._channel.wait_for_shutdown()


LOAD_NODE_TYPE = "composition_interfaces/srv/LoadNode"

_PARAMETER_TYPES = {
    bool: (1, "bool"),
    int: (2, "integer"),
    float: (3, "double"),
    str: (4, "string"),
}
"""rcl_interfaces/msg/ParameterType: the number of a type, and the field that holds its value; the
number of a list of them is greater by 5."""


class ComponentError(R2bspecError):
    """A component was not loaded."""

    code = "R2B665"


def load_request(node: NodePlan) -> dict[str, Any]:
    """Return the fields of ``composition_interfaces/srv/LoadNode`` for a node of a plan.

    Raises:
        ComponentError: a parameter has no type of ROS.
    """
    extra = {"use_intra_process_comms": True} if node.intra_process else {}
    extra |= node.extra_arguments or {}
    return {
        "package_name": node.package,
        "plugin_name": node.plugin,
        "node_name": node.node,
        "node_namespace": node.namespace,
        "remap_rules": [f"{left}:={right}" for left, right in node.remappings.items()],
        "parameters": _parameters(node, node.parameters),
        "extra_arguments": _parameters(node, extra),
    }


def _parameters(node: NodePlan, values: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Values as a list of rcl_interfaces/msg/Parameter."""
    return [
        {"name": name, "value": _parameter_value(node, name, value)}
        for name, value in values.items()
    ]


def _parameter_value(node: NodePlan, name: str, value: Any) -> dict[str, Any]:
    """Return a value as rcl_interfaces/msg/ParameterValue. The numbers of a list have one type."""
    if isinstance(value, list):
        kinds = {*map(type, value)}
        if kinds == {int, float}:
            kinds, value = {float}, [*map(float, value)]
        if len(kinds) == 1 and (kind := kinds.pop()) in _PARAMETER_TYPES:
            number, field = _PARAMETER_TYPES[kind]
            return {"type": number + 5, f"{field}_array_value": value}
    elif type(value) in _PARAMETER_TYPES:
        number, field = _PARAMETER_TYPES[type(value)]
        return {"type": number, f"{field}_value": value}
    raise ComponentError(
        f"parameter {name!r} of {node.name} cannot be {value!r}: a list needs at least one "
        "value, and values of one type",
        hint="Remove it to use the default.",
    )


class ComponentLoader:
    """Asks containers to load components, one after another."""

    def __init__(self, channel: Channel, _settings: protocol.ConfigureComponents) -> None:
        self._channel = channel
        self._node = rclpy_tools.start_node("components")

    def serve(self) -> None:
        """Load components on request, until told to shut down.

        Raises:
            ComponentError: a container does not respond in time, or a request cannot be made.
        """
        self._channel.send(protocol.Ready())
        while isinstance(command := self._channel.receive(), protocol.LoadComponent):
            self._channel.send(self._load(command))

    def _load(self, command: protocol.LoadComponent) -> protocol.Composed:
        node, container = command.node, command.container
        try:
            answer = call_service(
                self._node,
                LOAD_NODE_TYPE,
                f"{container}/_container/load_node",
                load_request(node),
                command.timeout_ns,
                interrupted=lambda: self._channel.wait(0.0),
            )
        except rclpy_tools.TypeNotFoundError as error:
            raise ComponentError(
                "ROS package 'composition_interfaces' is not installed",
                hint="It comes with rclcpp_components; source a full ROS 2 installation.",
                code="R2B622",
            ) from error
        except ServiceCallError as error:
            raise ComponentError(
                f"{node.plugin} of package {node.package} was not loaded into container "
                f"{container} as {node.name}: {error}",
                hint="Read the output of the container, or increase benchmark.start_timeout.",
            ) from error
        return protocol.Composed(loaded=answer.success, reason=answer.error_message)
