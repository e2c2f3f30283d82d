"""The parameters that running nodes declare, asked over their parameter services."""

from __future__ import annotations

import time
from typing import Any

from rclpy.executors import SingleThreadedExecutor

from r2bspec.harness import rclpy_tools
from r2bspec.ipc import protocol

_LIST = "/list_parameters"
_LIFECYCLE = "/change_state"
_LIFECYCLE_TYPE = "lifecycle_msgs/srv/ChangeState"
_SPIN_S = 0.02


def list_parameters(command: protocol.ListParameters) -> protocol.ParameterLists:
    """Ask all nodes that have parameter services, in parallel.

    A node that does not respond in time is left out. The node that asks has its own executor, so
    that the subscriptions of the process are not touched.
    """
    from rcl_interfaces.srv import ListParameters

    asking = rclpy_tools.start_node("parameters")
    executor = SingleThreadedExecutor()
    executor.add_node(asking)
    try:
        services = dict(asking.get_service_names_and_types())
        nodes = {name.removesuffix(_LIST) for name in services if name.endswith(_LIST)}
        clients = {
            name: asking.create_client(ListParameters, f"{name}{_LIST}")
            for name in sorted(nodes - {*command.exclude})
        }
        deadline = time.monotonic() + command.timeout_ns / 1e9
        futures: dict[str, Any] = {}
        while time.monotonic() < deadline:
            for name, client in clients.items():
                if name not in futures and client.service_is_ready():
                    futures[name] = client.call_async(ListParameters.Request())
            if len(futures) == len(clients) and all(each.done() for each in futures.values()):
                break
            executor.spin_once(timeout_sec=_SPIN_S)
        return protocol.ParameterLists(
            parameters={
                name: tuple(sorted(future.result().result.names))
                for name, future in futures.items()
                if future.done() and future.exception() is None
            },
            lifecycle=tuple(
                sorted(
                    name.removesuffix(_LIFECYCLE)
                    for name, types in services.items()
                    if name.endswith(_LIFECYCLE) and _LIFECYCLE_TYPE in types
                )
            ),
        )
    finally:
        executor.shutdown()
        asking.destroy_node()
