"""The service client: makes one service call, as an `after_ready` step."""

from __future__ import annotations

import importlib
import time
from typing import Any

import rclpy
from rclpy.node import Node

from r2bspec.harness import rclpy_tools
from r2bspec.harness.control_channel import Channel
from r2bspec.ipc import protocol


class ServiceCallError(Exception):
    """A call cannot be made or gets no response; the message is for the user."""

    code = "R2B647"


def service_class(type_name: str) -> Any:
    """The class of a service type such as ``std_srvs/srv/Trigger``.

    Raises:
        ServiceCallError: the package is not installed or has no such service.
    """
    package, _, name = type_name.partition("/srv/")
    try:
        return getattr(importlib.import_module(f"{package}.srv"), name)
    except (ImportError, AttributeError, ValueError) as error:
        raise ServiceCallError(f"service type {type_name} is not installed") from error


def fill_message(message: Any, values: dict[str, Any], path: str = "") -> Any:
    """Set the fields of a message from a mapping, nested messages from nested mappings.

    Raises:
        ServiceCallError: a field does not exist, or a value has the wrong type.
    """
    fields = message.get_fields_and_field_types()
    for name, value in values.items():
        where = f"{path}.{name}" if path else name
        if name not in fields:
            raise ServiceCallError(
                f"the request has no field {where!r}; its fields: {', '.join(fields)}"
            )
        fitting = _field_value(getattr(message, name), fields[name], value, where)
        try:
            setattr(message, name, fitting)
        except (AssertionError, TypeError, ValueError) as error:
            raise ServiceCallError(
                f"{where} cannot be {value!r}: its type is {fields[name]}"
            ) from error
    return message


def _field_value(current: Any, type_name: str, value: Any, where: str) -> Any:
    """The value of a field; mappings are converted to messages."""
    if isinstance(value, dict):
        return fill_message(current, value, where)
    if isinstance(value, list) and value and isinstance(value[0], dict):
        element = type_name.removeprefix("sequence<").split("<")[-1].rstrip(">").split(",")[0]
        package, _, name = element.partition("/")
        made = rclpy_tools.message_class(f"{package}/msg/{name}")
        return [fill_message(made(), each, f"{where}[{index}]") for index, each in enumerate(value)]
    if type(current) is float and type(value) is int:
        return float(value)
    # Messages do not check the types of their fields by default, and would fail when sent.
    scalar = isinstance(current, bool | int | float | str)
    if type(value) is not (type(current) if scalar else list):
        raise ServiceCallError(f"{where} cannot be {value!r}: its type is {type_name}")
    return value


def call_service(
    node: Node, type_name: str, service: str, request: dict[str, Any], deadline: float
) -> Any:
    """Wait for a service, call it, and wait for its response.

    Args:
        node: makes the call; no executor may spin it.
        type_name: such as ``std_srvs/srv/Trigger``.
        service: its full name.
        request: the fields of the request; others keep their defaults.
        deadline: on the monotonic clock, in seconds.

    Raises:
        ServiceCallError: the service does not exist, does not accept the request, or does not
            respond before the deadline.
    """
    kind = service_class(type_name)
    message = fill_message(kind.Request(), request)
    client = node.create_client(kind, service)
    try:
        if not client.wait_for_service(max(0.0, deadline - time.monotonic())):
            raise ServiceCallError(f"service {service} does not exist")
        future = client.call_async(message)
        rclpy.spin_until_future_complete(
            node, future, timeout_sec=max(0.0, deadline - time.monotonic())
        )
        if not future.done():
            raise ServiceCallError(f"service {service} did not respond in time")
        return future.result()
    finally:
        node.destroy_client(client)


class ServiceCaller:
    """Waits for a service, calls it once, and reports the response."""

    def __init__(self, channel: Channel, settings: protocol.ConfigureCaller) -> None:
        self._channel = channel
        self._settings = settings
        self._node: Node = rclpy_tools.start_node("caller")

    def serve(self) -> None:
        """Make the call; `Called` follows `Ready`.

        Raises:
            ServiceCallError: the service does not exist, or does not respond in time.
        """
        self._channel.send(protocol.Ready())
        settings = self._settings
        deadline = time.monotonic() + settings.timeout_ns / 1e9
        call_service(
            self._node, settings.service_type, settings.service, settings.request, deadline
        )
        self._channel.send(protocol.Called())
        while not isinstance(self._channel.receive(), protocol.Shutdown):
            pass
