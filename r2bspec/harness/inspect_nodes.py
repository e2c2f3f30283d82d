"""Topics, services and parameters of running nodes, as JSON.

Both programs wait until discovery shows nothing new, and query the nodes for their parameters over
their services; they change nothing in the graph::

    -m r2bspec.harness.inspect_nodes NAMESPACE SECONDS FILE     the nodes of one process
    -m r2bspec.harness.inspect_nodes SECONDS FILE               every node of a running graph

The first one is a child of the controller, to which it reports completion with `Ready`.
"""

from __future__ import annotations

import json
import os
import sys
import time
from pathlib import Path
from typing import Any

from r2bspec.exit_status import ExitStatus
from r2bspec.harness.control_channel import Channel, ChannelClosedError
from r2bspec.ipc import protocol

_QUIET_PERIOD_S = 1.5
"""Discovery is complete when it has shown nothing new for this time."""

_POLL_S = 0.1
_CALL_S = 10.0

_COMMON_TOPICS = frozenset({"/rosout", "/parameter_events"})
_COMMON_SERVICES = (
    "describe_parameters",
    "get_parameters",
    "get_parameter_types",
    "list_parameters",
    "set_parameters",
    "set_parameters_atomically",
    "get_type_description",
)
_COMMON_PARAMETERS = frozenset({"use_sim_time", "start_type_description_service"})
_PARAMETER_TYPES = (
    "",
    "bool",
    "integer",
    "double",
    "string",
    "byte_array",
    "bool_array",
    "integer_array",
    "double_array",
    "string_array",
)
"""Names of parameter types by their number in rcl_interfaces/msg/ParameterType."""


class Inspector:
    """Inspects one namespace, in which the nodes of one process run.

    Args:
        namespace: absolute, without a trailing ``/``.
        timeout_s: how long to wait for the first node.
    """

    def __init__(self, namespace: str, timeout_s: float) -> None:
        from r2bspec.harness import rclpy_tools

        self._namespace = namespace
        self._timeout_s = timeout_s
        self._node = rclpy_tools.start_node("inspector")

    def inspect(self) -> dict[str, Any]:
        """The names of the nodes, and their topics, services, QoS profiles and parameters."""
        nodes = self._wait_for_discovery()
        found: dict[str, Any] = {
            "nodes": [name for name, _ in nodes],
            "subscribes": {},
            "publishes": {},
            "services": {},
            "qos": {},
            "parameters": {},
        }
        for name, namespace in nodes:
            self._topics(name, namespace, found)
            self._services(name, namespace, found)
            found["parameters"] |= self._parameters(name, namespace)
        return found

    def _wait_for_discovery(self) -> list[tuple[str, str]]:
        """Wait until there are nodes and, for a while, no changes of their endpoints."""
        deadline_s = time.monotonic() + self._timeout_s
        last: Any = None
        since_s = time.monotonic()
        while time.monotonic() < deadline_s:
            nodes = self._nodes()
            now = [(each, self._endpoints(*each)) for each in nodes]
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
            if f"{namespace}/".startswith(inside) and not name.endswith("_container")
        )

    def _endpoints(self, name: str, namespace: str) -> Any:
        try:
            return (
                sorted(self._node.get_publisher_names_and_types_by_node(name, namespace)),
                sorted(self._node.get_subscriber_names_and_types_by_node(name, namespace)),
                sorted(self._node.get_service_names_and_types_by_node(name, namespace)),
            )
        except Exception:  # a node may disappear between two queries
            return ()

    def _topics(self, name: str, namespace: str, found: dict[str, Any]) -> None:
        node = self._node
        for side, topics, infos in (
            (
                "publishes",
                node.get_publisher_names_and_types_by_node(name, namespace),
                node.get_publishers_info_by_topic,
            ),
            (
                "subscribes",
                node.get_subscriber_names_and_types_by_node(name, namespace),
                node.get_subscriptions_info_by_topic,
            ),
        ):
            for topic, types in topics:
                if topic in _COMMON_TOPICS:
                    continue
                own = self._relative_name(topic, name)
                found[side][own] = types[0]
                for info in infos(topic):
                    if (info.node_name, info.node_namespace) == (name, namespace):
                        found["qos"][own] = _profile(info.qos_profile)

    def _services(self, name: str, namespace: str, found: dict[str, Any]) -> None:
        for service, types in self._node.get_service_names_and_types_by_node(name, namespace):
            if service.rpartition("/")[2] not in _COMMON_SERVICES:
                found["services"][self._relative_name(service, name)] = types[0]

    def _relative_name(self, full: str, node: str) -> str:
        """The name that a node itself may use for a topic."""
        inside = f"{self._namespace}/"
        if full.startswith(f"{inside}{node}/"):
            return f"~/{full.removeprefix(f'{inside}{node}/')}"
        return full.removeprefix(inside)

    def _parameters(self, name: str, namespace: str) -> dict[str, Any]:
        from rcl_interfaces.srv import DescribeParameters, GetParameters, ListParameters

        where = f"{namespace}/{name}"
        listed = self._call(ListParameters, f"{where}/list_parameters", ListParameters.Request())
        names = [
            each
            for each in (listed.result.names if listed is not None else ())
            if each not in _COMMON_PARAMETERS and not each.startswith("qos_overrides.")
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
            each.name: {"type": _PARAMETER_TYPES[each.type]} | _default_value(value)
            for each, value in zip(described.descriptors, values.values, strict=True)
        }

    def _call(self, kind: Any, name: str, request: Any) -> Any:
        """The response of a service; None if there is none."""
        import rclpy

        client = self._node.create_client(kind, name)
        try:
            if not client.wait_for_service(timeout_sec=_CALL_S):
                return None
            future = client.call_async(request)
            rclpy.spin_until_future_complete(self._node, future, timeout_sec=_CALL_S)
            return future.result()
        finally:
            self._node.destroy_client(client)


def _profile(qos: Any) -> dict[str, str]:
    """The fields of a profile that discovery shows, which do not include the depth."""
    return {
        "reliability": "best_effort" if qos.reliability.name == "BEST_EFFORT" else "reliable",
        "durability": "transient_local" if qos.durability.name == "TRANSIENT_LOCAL" else "volatile",
    }


def _default_value(value: Any) -> dict[str, Any]:
    """The value of a parameter."""
    name = _PARAMETER_TYPES[value.type]
    if not name:
        return {}
    content = getattr(value, f"{name}_value")
    if name == "byte_array":
        return {}
    return {"default": list(content) if name.endswith("_array") else content}


def write_namespace() -> int:
    """Inspect the namespace that the command line names; returns the exit status."""
    namespace, timeout_s, target = sys.argv[1], float(sys.argv[2]), Path(sys.argv[3])
    channel = Channel.from_environment()
    try:
        found = Inspector(namespace, timeout_s).inspect()
        target.write_text(json.dumps(found, indent=1), encoding="utf-8")
        channel.send(protocol.Ready())
        while not isinstance(channel.receive(), protocol.Shutdown):
            pass
    except ChannelClosedError:
        return ExitStatus.OK
    except Exception as error:
        channel.send(protocol.Failed(code="R2B630", message=f"{type(error).__name__}: {error}"))
        return ExitStatus.FINDINGS_OR_FAILED
    return ExitStatus.OK


_OWN_NAMESPACE = "/r2bspec"
_KEYS = ("subscribes", "publishes", "services", "qos", "parameters")


class GraphInspector(Inspector):
    """Inspects every node of the graph but its own, hidden ones and component containers.

    Args:
        timeout_s: how long to wait for the first node.
    """

    def __init__(self, timeout_s: float) -> None:
        super().__init__("", timeout_s)

    def nodes(self) -> list[dict[str, Any]]:
        """Each node with its name, namespace and interface; topics have absolute names."""
        found = []
        for name, namespace in self._wait_for_discovery():
            entry: dict[str, Any] = {key: {} for key in _KEYS}
            self._topics(name, namespace, entry)
            self._services(name, namespace, entry)
            entry["parameters"] = self._parameters(name, namespace)
            found.append({"name": name, "namespace": namespace, **entry})
        return found

    def _nodes(self) -> list[tuple[str, str]]:
        return [
            (name, namespace)
            for name, namespace in super()._nodes()
            if namespace != _OWN_NAMESPACE and not name.startswith(("_", "launch_ros_"))
        ]

    def _relative_name(self, full: str, node: str) -> str:
        del node
        return full


def write_graph() -> int:
    """Write the nodes of the graph to a file; returns the exit status."""
    timeout_s, target = float(sys.argv[1]), Path(sys.argv[2])
    target.write_text(json.dumps(GraphInspector(timeout_s).nodes()), encoding="utf-8")
    return ExitStatus.OK


if __name__ == "__main__":
    status = write_graph() if len(sys.argv) == 3 else write_namespace()
    from r2bspec.harness import rclpy_tools

    rclpy_tools.finish()
    os._exit(status)
