"""Topics, services and parameters of running nodes, as JSON.

An inspector waits until discovery shows nothing new, and queries the nodes for their parameters
over their services; it changes nothing in the graph. As a child of the controller it inspects the
nodes of one process. As a program it inspects every node of a running graph::

    -m r2bspec.harness.inspect_nodes SECONDS FILE
"""

from __future__ import annotations

import contextlib
import json
import os
import sys
import time
from pathlib import Path
from typing import Any, get_args

from rcl_interfaces.srv import DescribeParameters, GetParameters, ListParameters
from rclpy.node import NodeNameNonExistentError

from r2bspec.errors import ExitStatus
from r2bspec.harness import rclpy_tools
from r2bspec.harness.control_channel import Channel
from r2bspec.ipc import protocol
from r2bspec.plan.wiring.name_resolution import NODE_TOPICS, is_node_parameter
from r2bspec.plan.wiring.node_interface import ParameterType

_QUIET_PERIOD_S = 1.5
"""Discovery is complete when it has shown nothing new for this time."""

_POLL_S = 0.1
_CALL_S = 10.0
_NO_DEADLINE_NS = 9_000_000_000_000_000_000
"""Discovery shows that there is none as a time above this."""

_COMMON_SERVICES = (
    "describe_parameters",
    "get_parameters",
    "get_parameter_types",
    "list_parameters",
    "set_parameters",
    "set_parameters_atomically",
    "get_type_description",
)
_OWN_NAMESPACE = "/r2bspec"
_PARAMETER_TYPES = ("", *get_args(ParameterType))
"""Names of parameter types by their number in rcl_interfaces/msg/ParameterType."""


class Inspector:
    """Inspects nodes other than its own, hidden nodes and component containers.

    Args:
        timeout_s: how long to wait for the first node.
        namespace: the only one that is inspected, absolute, without a trailing ``/``; empty for the
            whole graph.
    """

    def __init__(self, timeout_s: float, namespace: str = "") -> None:
        self._namespace = namespace
        self._timeout_s = timeout_s
        self._node = rclpy_tools.start_node("inspector")

    def nodes(self) -> list[dict[str, Any]]:
        """Return each node with its name, namespace, topics, services, QoS and parameters."""
        found = []
        for name, namespace in self._wait_for_discovery():
            # A node may end between two queries; it is no part of the graph any more.
            with contextlib.suppress(NodeNameNonExistentError):
                found.append(
                    {
                        "name": name,
                        "namespace": namespace,
                        **self._topics(name, namespace),
                        "services": self._services(name, namespace),
                        "parameters": self._parameters(name, namespace),
                    }
                )
        return found

    def _wait_for_discovery(self) -> list[tuple[str, str]]:
        """Wait until there are nodes and, for a while, no changes of their endpoints."""
        deadline_s = time.monotonic() + self._timeout_s
        last: Any = None
        since_s = time.monotonic()
        while time.monotonic() < deadline_s:
            nodes = self._nodes()
            now = [(each, rclpy_tools.names_of(self._node, *each)) for each in nodes]
            if now != last:
                last, since_s = now, time.monotonic()
            elif nodes and time.monotonic() - since_s > _QUIET_PERIOD_S:
                return nodes
            time.sleep(_POLL_S)
        return self._nodes()

    def _nodes(self) -> list[tuple[str, str]]:
        inside = f"{self._namespace}/"
        return sorted(
            (name, namespace)
            for name, namespace in self._node.get_node_names_and_namespaces()
            if f"{namespace}/".startswith(inside)
            and namespace != _OWN_NAMESPACE
            and not name.startswith(("_", "launch_ros_"))
            and not name.endswith("_container")
        )

    def _topics(self, name: str, namespace: str) -> dict[str, dict[str, Any]]:
        """Return what a node subscribes to and publishes, with types, and the QoS profiles."""
        node = self._node
        subscribed = node.get_subscriber_names_and_types_by_node(name, namespace)
        published = node.get_publisher_names_and_types_by_node(name, namespace)
        interface: dict[str, dict[str, Any]] = {"subscribes": {}, "publishes": {}, "qos": {}}
        for side, topics, infos in (
            ("publishes", published, node.get_publishers_info_by_topic),
            ("subscribes", subscribed, node.get_subscriptions_info_by_topic),
        ):
            for topic, types in topics:
                if topic not in NODE_TOPICS:
                    own = self._relative_name(topic, name)
                    interface[side][own] = types[0]
                    for info in infos(topic):
                        if (info.node_name, info.node_namespace) == (name, namespace):
                            interface["qos"][own] = _profile(info.qos_profile)
        return interface

    def _services(self, name: str, namespace: str) -> dict[str, str]:
        services = self._node.get_service_names_and_types_by_node(name, namespace)
        return {
            self._relative_name(service, name): types[0]
            for service, types in services
            if service.rpartition("/")[2] not in _COMMON_SERVICES
        }

    def _relative_name(self, full: str, node: str) -> str:
        """Return the name that a node itself may use for a topic.

        In the whole graph, the full name.
        """
        if not self._namespace:
            return full
        inside = f"{self._namespace}/"
        if full.startswith(f"{inside}{node}/"):
            return f"~/{full.removeprefix(f'{inside}{node}/')}"
        return full.removeprefix(inside)

    def _parameters(self, name: str, namespace: str) -> dict[str, Any]:
        where = f"{namespace}/{name}"
        listed = self._call(ListParameters, f"{where}/list_parameters", ListParameters.Request())
        names = [
            full_name
            for full_name in (listed.result.names if listed is not None else ())
            if not is_node_parameter(full_name)
        ]
        if not names:
            return {}
        request = DescribeParameters.Request(names=names)
        described = self._call(DescribeParameters, f"{where}/describe_parameters", request)
        values = self._call(
            GetParameters, f"{where}/get_parameters", GetParameters.Request(names=names)
        )
        if described is None or values is None:
            return {}
        return {
            descriptor.name: {"type": _PARAMETER_TYPES[descriptor.type]} | _default_value(value)
            for descriptor, value in zip(described.descriptors, values.values, strict=True)
        }

    def _call(self, kind: Any, name: str, request: Any) -> Any:
        """Return the response of a service; None if there is none."""
        return rclpy_tools.ask_services(self._node, kind, [name], _CALL_S, request).get(name)


def _profile(qos: Any) -> dict[str, str]:
    """Return the fields of a profile that discovery shows, which do not include the depth."""
    shown = {
        "reliability": "best_effort" if qos.reliability.name == "BEST_EFFORT" else "reliable",
        "durability": "transient_local" if qos.durability.name == "TRANSIENT_LOCAL" else "volatile",
    }
    if qos.deadline.nanoseconds < _NO_DEADLINE_NS:
        shown["deadline"] = f"{qos.deadline.nanoseconds} ns"
    if qos.liveliness.name == "MANUAL_BY_TOPIC":
        shown["liveliness"] = "manual_by_topic"
    return shown


def _default_value(value: Any) -> dict[str, Any]:
    """Return the value of a parameter."""
    name = _PARAMETER_TYPES[value.type]
    if not name:
        return {}
    content = getattr(value, f"{name}_value")
    if name == "byte_array":
        return {}
    return {"default": list(content) if name.endswith("_array") else content}


class NamespaceInspector:
    """Inspects the nodes of one process, as a child of the controller."""

    def __init__(self, channel: Channel, settings: protocol.ConfigureInspector) -> None:
        self._channel = channel
        self._settings = settings

    def serve(self) -> None:
        """Write the interfaces to a file; `Ready` says that it is complete."""
        settings = self._settings
        _write(Inspector(settings.timeout_s, settings.namespace), Path(settings.file))
        self._channel.send(protocol.Ready())
        self._channel.wait_for_shutdown()


def _write(inspector: Inspector, target: Path) -> None:
    target.write_text(json.dumps(inspector.nodes()), encoding="utf-8")


if __name__ == "__main__":
    _write(Inspector(float(sys.argv[1])), Path(sys.argv[2]))
    rclpy_tools.finish()
    os._exit(ExitStatus.OK)
