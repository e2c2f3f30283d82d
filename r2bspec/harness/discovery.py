"""What discovery shows of the running graph: endpoints, nodes, parameters, and foreign publishers.

A domain keeps runs apart that r2bspec started, but it is no fence: a program of another user that
joins it can publish on the topics of the run. What it publishes is measured, or handed to the
nodes, like anything else. `PublisherGuard` therefore looks at who publishes.
"""

from __future__ import annotations

import contextlib
import os
import pwd
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import msgspec
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.topic_endpoint_info import TopicEndpointInfo

from r2bspec.harness import rclpy_tools
from r2bspec.ipc import protocol
from r2bspec.ipc.protocol import RUN_ID_VARIABLE, ForeignPublisher
from r2bspec.middleware.middleware import PROC, middleware_of


def discover(node: Node, topics: tuple[str, ...]) -> protocol.Discovered:
    """The endpoints that discovery shows on these topics, including those of the harness."""
    publishers = {each: node.get_publishers_info_by_topic(each) for each in topics}
    subscriptions = {each: node.get_subscriptions_info_by_topic(each) for each in topics}
    return protocol.Discovered(
        writers={topic: tuple(map(_endpoint, infos)) for topic, infos in publishers.items()},
        readers={topic: tuple(map(_endpoint, infos)) for topic, infos in subscriptions.items()},
        qos_mismatches=tuple(
            protocol.QosMismatch(_full_name(publisher), _full_name(subscription), topic, why)
            for topic in topics
            for publisher in publishers[topic]
            for subscription in subscriptions[topic]
            if (
                why := rclpy_tools.qos_mismatch_reason(
                    publisher.qos_profile, subscription.qos_profile
                )
            )
        ),
    )


def _endpoint(info: TopicEndpointInfo) -> protocol.Endpoint:
    return protocol.Endpoint(
        node=_full_name(info),
        type=info.topic_type,
        reliability=info.qos_profile.reliability.name.lower(),
        durability=info.qos_profile.durability.name.lower(),
    )


def _full_name(info: TopicEndpointInfo) -> str:
    return f"{info.node_namespace.rstrip('/')}/{info.node_name}"


def list_graph(node: Node) -> protocol.GraphSnapshot:
    """The full names of the nodes, services and topics that discovery shows."""
    return protocol.GraphSnapshot(
        nodes=tuple(
            f"{namespace.rstrip('/')}/{name}"
            for name, namespace in node.get_node_names_and_namespaces()
        ),
        services=tuple(name for name, _ in node.get_service_names_and_types()),
        topics=tuple(name for name, _ in node.get_topic_names_and_types()),
    )


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


LOOK_PERIOD_S = 0.2
_UNKNOWN_NODE = "_NODE_NAME_UNKNOWN_"
"""What rmw says of a node whose name has not been discovered yet."""
_MAX_PROCESSES = 3


class PublisherGuard:
    """Remembers every publisher on some topics that no process of the run may have made."""

    def __init__(self, node: Node, topics: tuple[str, ...]) -> None:
        self._node = node
        self._counts = dict.fromkeys(topics, 0)
        self._known: set[tuple[str, str]] = set()
        self._foreign: dict[tuple[str, str], ForeignPublisher] = {}
        self._next_s = 0.0

    def foreign(self) -> tuple[ForeignPublisher, ...]:
        """All that were seen until now."""
        self.look(now=True)
        return tuple(self._foreign.values())

    def look(self, *, now: bool = False) -> None:
        """See who publishes; looks at most five times a second, unless told `now`.

        To count publishers takes some microseconds, so that is what happens while a run measures.
        """
        if not now and time.monotonic() < self._next_s:
            return
        self._next_s = time.monotonic() + LOOK_PERIOD_S
        for topic, before in self._counts.items():
            count = self._node.count_publishers(topic)
            if now or count != before or self._lacks_a_name(topic):
                self._counts[topic] = count
                self._look_at(topic)

    def _lacks_a_name(self, topic: str) -> bool:
        return any(
            each.topic == topic and _UNKNOWN_NODE in each.node for each in self._foreign.values()
        )

    def _look_at(self, topic: str) -> None:
        for info in self._node.get_publishers_info_by_topic(topic):
            gid = bytes(info.endpoint_gid)
            key = (topic, gid.hex())
            node = f"{info.node_namespace.rstrip('/')}/{info.node_name}"
            if key in self._foreign:
                # An endpoint is discovered before its node: the name may come with a later look.
                if _UNKNOWN_NODE in self._foreign[key].node:
                    self._foreign[key] = msgspec.structs.replace(self._foreign[key], node=node)
            elif key not in self._known:
                self._known.add(key)
                processes = list(_processes_of(gid))
                if not any(map(_is_of_this_run, processes)):
                    self._foreign[key] = ForeignPublisher(
                        topic=topic,
                        node=node,
                        gid=gid.hex(),
                        processes=tuple(map(_describe, processes[:_MAX_PROCESSES])),
                    )


def _processes_of(gid: bytes) -> Iterator[Path]:
    """The processes of this host that an endpoint can belong to, by its identifier."""
    middleware = middleware_of(os.environ)
    for folder in PROC.glob("[0-9]*"):
        if middleware.may_be_endpoint_of(gid, (int(folder.name),)):
            yield folder


def _is_of_this_run(folder: Path) -> bool:
    wanted = f"{RUN_ID_VARIABLE}={os.environ.get(RUN_ID_VARIABLE, '')}".encode()
    with contextlib.suppress(OSError):
        return wanted in (folder / "environ").read_bytes().split(b"\0")
    return False


def _describe(folder: Path) -> str:
    name, user = "?", "?"
    with contextlib.suppress(OSError):
        name = (folder / "comm").read_text(errors="replace").strip()
        owner = folder.stat().st_uid
        user = str(owner)
        with contextlib.suppress(KeyError):
            user = pwd.getpwuid(owner).pw_name
    return f"{name} ({folder.name}) of user {user}"
