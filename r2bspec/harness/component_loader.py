"""Loading C++ components into their containers, as ``ros2 component load`` does."""

from __future__ import annotations

import time

from r2bspec.harness import rclpy_tools
from r2bspec.harness.control_channel import Channel
from r2bspec.harness.load_node_request import (
    LOAD_NODE_TYPE,
    ComponentError,
    load_error,
    load_request,
    load_service_name,
)
from r2bspec.harness.service_client import ServiceCallError, call_service, service_class
from r2bspec.ipc import protocol
from r2bspec.plan.plan import NodePlan


class ComponentLoader:
    """Loads components one after another, and reports when all are loaded."""

    def __init__(self, channel: Channel, settings: protocol.ConfigureComponents) -> None:
        self._channel = channel
        self._settings = settings
        self._node = rclpy_tools.start_node("components")

    def serve(self) -> None:
        """Load them; `Composed` follows `Ready`.

        Raises:
            ComponentError: a container does not respond in time, or rejects a component.
        """
        self._channel.send(protocol.Ready())
        deadline = time.monotonic() + self._settings.timeout_ns / 1e9
        loaded = tuple(
            self._load(each.container, node, deadline)
            for each in self._settings.containers
            for node in each.nodes
        )
        self._channel.send(protocol.Composed(nodes=loaded))
        while not isinstance(self._channel.receive(), protocol.Shutdown):
            pass

    def _load(self, container: str, node: NodePlan, deadline: float) -> str:
        """Load one component; returns the full name of its node."""
        request = load_request(node)
        try:
            service_class(LOAD_NODE_TYPE)
        except ServiceCallError as error:
            raise ComponentError(
                "ROS package 'composition_interfaces' is not installed",
                hint="It comes with rclcpp_components; source a full ROS 2 installation.",
                code="R2B622",
            ) from error
        try:
            answer = call_service(
                self._node, LOAD_NODE_TYPE, load_service_name(container), request, deadline
            )
        except ServiceCallError as error:
            raise ComponentError(
                load_error(node, container, success=False, reason=str(error)),
                hint="Read the output of the container, or increase benchmark.start_timeout.",
            ) from error
        if wrong := load_error(node, container, answer.success, answer.error_message):
            raise ComponentError(
                wrong, hint=f"'ros2 component types {node.package}' lists its components."
            )
        return str(answer.full_node_name)
